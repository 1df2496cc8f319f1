"""Means, bounds and fronts of measured points, and their files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import StoreError
from pipeline.tradeoff.measured import read_trade, read_trades, trade_path
from tests.tradeoff.measured_trades import point, trade


def test_bound_is_above_the_mean_of_19_in_20_other_samples() -> None:
    rng = np.random.default_rng(0)
    kept = []
    for _ in range(400):
        known, other = rng.lognormal(sigma=0.5, size=(2, 8))
        kept.append(other.mean() <= point("a", 1, known).bound(8))
    assert np.mean(kept) >= 0.95


def test_bound_falls_with_the_number_of_objects_and_is_infinite_for_one() -> None:
    some = point("a", 1, [1, 2, 3, 4])
    assert some.error < some.bound(1000) < some.bound(4)
    assert point("a", 1, [1]).bound(4) == np.inf


def test_bound_of_a_zero_share_follows_the_rule_of_three() -> None:
    assert point("a", 1, [0, 0, 0, 0]).bound(100, trials=20) == pytest.approx(300 / 80)
    assert point("a", 1, [0, 0, 0, 0]).bound(100) == 0


def test_front_contains_the_pareto_optimal_points() -> None:
    fast, good, bad, best = point("fast", 1, [4, 4]), point("good", 2, [2, 2]), point("bad", 3, [3, 3]), point("best", 4, [1, 1])
    assert trade("sample-surfaces", "mm", best, bad, fast, good).front() == [fast, good, best]


def test_trade_is_read_as_written_and_damage_is_named(tmp_path: Path) -> None:
    written = trade("sample-surfaces", "mm", point("a", 1, [1, 2]), point("b", 2, [0.5, 1], points=5))
    written.write(tmp_path)
    assert read_trade(tmp_path, "sample-surfaces") == written
    assert read_trades(tmp_path, ("sample-surfaces", "render-vision")) == [written]
    assert written.own() == written.points[0]
    trade_path(tmp_path, "sample-surfaces").write_text("{}")
    with pytest.raises(StoreError, match="remove it, then run `vt-pipeline tradeoff sample-surfaces`"):
        read_trade(tmp_path, "sample-surfaces")
