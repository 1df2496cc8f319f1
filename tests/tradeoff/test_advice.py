"""Advice against all combinations of settings, and how limits are read."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.tradeoff.advice import Limit, Workload, choices, parse_duration, parse_limit, within_error, within_time
from pipeline.tradeoff.measured import MeasuredTrade
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
        with pytest.raises(InvalidInput, match="the fastest measured settings take"):
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


@pytest.mark.parametrize(("text", "seconds"), [("90s", 90), ("10min", 600), (" 1.5 h ", 5400), ("2d", 172800)])
def test_durations_are_read(text: str, seconds: float) -> None:
    assert parse_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "3", "0h", "h", "3 weeks", "-1h"])
def test_other_durations_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match="write 90s, 10min"):
        parse_duration(text)


@pytest.mark.parametrize(
    ("text", "limit"), [("0.1mm", Limit(0.1, "mm")), ("5 %", Limit(5, "%")), ("train-gcn=12", Limit(12, "", "train-gcn"))]
)
def test_limits_are_read(text: str, limit: Limit) -> None:
    assert parse_limit(text) == limit


@pytest.mark.parametrize("text", ["", "3", "mm", "x=y"])
def test_other_limits_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match="write a number and its unit"):
        parse_limit(text)
