"""Means, bounds and fronts of measured points, and their files; advice against all combinations of settings, and how limits are read."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InvalidInput, StoreError
from pipeline.tradeoff.trades import (
    Limit,
    MeasuredTrade,
    Workload,
    choices,
    parse_duration,
    parse_limit,
    read_trade,
    trade_path,
    within_error,
    within_time,
)
from tests.tradeoff.measured_trades import point, trade

LOAD = Workload(objects=10, cores=2)


def drawn(seed: int) -> list[MeasuredTrade]:
    """Draw three trades of four points."""
    rng = np.random.default_rng(seed)
    return [
        trade(stage, "mm", *(point(f"{number}", rng.uniform(1, 9), rng.uniform(1, 9, 4), points=number) for number in range(4)))
        for stage in ("sample-surfaces", "simulate-grasps", "simulate-touch")
    ]


@pytest.mark.parametrize("seed", range(10))
def test_advice_within_a_time_is_the_best_of_all_combinations(seed: int) -> None:
    trades, limit = drawn(seed), 80.0
    every = list(itertools.product(*(choices(one, LOAD) for one in trades)))
    fitting = [some for some in every if sum(one.seconds for one in some) <= limit]
    if not fitting:
        with pytest.raises(InvalidInput, match="the fastest settings take"):
            within_time(trades, LOAD, limit)
        return
    best = min(math.prod(one.bound for one in some) for some in fitting)
    chosen = within_time(trades, LOAD, limit)
    assert math.prod(one.bound for one in chosen) == pytest.approx(best)
    assert sum(one.seconds for one in chosen) <= limit


def test_objects_share_cores_and_a_training_does_not() -> None:
    one = trade("sample-surfaces", "mm", point("a", 2, [1, 1]))
    learned = trade("train-unet", "um", point("a", 2, [1, 1]), trained=2)
    assert LOAD.seconds(one, one.points[0]) == 10  # five rounds of two
    assert LOAD.seconds(learned, learned.points[0]) == 10  # half of ten objects, one after the other


def test_limit_on_lengths_is_kept_by_every_length_and_leaves_others_alone() -> None:
    fine, coarse = point("fine", 2, [0.05] * 4, points=2), point("coarse", 1, [0.5] * 4, points=1)
    trades = [
        trade("sample-surfaces", "mm", point("own", 3, [0.01] * 4), fine, coarse),
        trade(
            "simulate-touch",
            "um",
            point("own", 3, [10] * 4),
            point("fast", 1, [90] * 4, gel_bits=1),
            point("faster", 0.5, [110] * 4, gel_bits=0),
        ),
        trade("simulate-grasps", "%", point("own", 3, [5] * 4), point("fast", 1, [50] * 4, attempts=1)),
    ]
    chosen = within_error(trades, LOAD, parse_limit("0.1mm"))
    assert [one.point.label for one in chosen] == ["fine", "fast", "own"]
    assert chosen[0].assignments() == ["sample-surfaces.points=2"]
    assert [one.point.label for one in within_error(trades, LOAD, parse_limit("simulate-grasps=60%"))] == ["own", "own", "fast"]
    with pytest.raises(
        InvalidInput, match=r"sample-surfaces: how wrong it is: at best 0\.01 mm is kept to, not 5e-05; allow a larger error"
    ):
        within_error(trades, LOAD, Limit(0.05, "um"))
    with pytest.raises(InvalidInput, match="no error is measured so; there are sample-surfaces in mm"):
        within_error(trades, LOAD, Limit(1, "levels"))
    trades[1] = trade("simulate-touch", "%", point("fast", 1, [1] * 4, gel_bits=1))
    with pytest.raises(InvalidInput, match="simulate-touch: your own settings were not measured, for lack of time"):
        within_error(trades, LOAD, parse_limit("0.1mm"))


def test_bound_of_a_training_is_of_as_many_test_objects_as_a_dataset_has() -> None:
    learned = trade("train-unet", "um", point("a", 2, [1, 2]), trained=2)  # half of four objects are tested
    assert choices(learned, LOAD)[0].bound == learned.points[0].bound(5)


def test_durations_and_limits_are_read_and_others_refused() -> None:
    assert [parse_duration(text) for text in ("90s", "10min", " 1.5 h ", "2d")] == [90, 600, 5400, 172800]
    limits = [Limit(0.1, "mm"), Limit(5, "%"), Limit(12, "", "train-gcn")]
    assert [parse_limit(text) for text in ("0.1mm", "5 %", "train-gcn=12")] == limits
    for parse, texts in ((parse_duration, ("", "3", "0h", "h", "3 weeks", "-1h")), (parse_limit, ("", "3", "mm", "x=y"))):
        for text in texts:
            with pytest.raises(InvalidInput, match="write"):
                parse(text)


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
    assert read_trade(tmp_path, "render-vision") is None
    assert written.own() == written.points[0]
    trade_path(tmp_path, "sample-surfaces").write_text("{}")
    with pytest.raises(StoreError, match="remove it, then run `vt-pipeline tradeoff sample-surfaces`"):
        read_trade(tmp_path, "sample-surfaces")
