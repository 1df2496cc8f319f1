"""Choosing among measured settings: what fits a time or an error, and what is said where nothing does."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from benchmarks.tradeoff.errors import Errors
from pipeline.errors import AdviceError
from pipeline.tuning.advice import Limit, Pace, assignments, duration, error_limit, fastest, within_error, within_time
from pipeline.tuning.tradeoff import Point, Trade


def point(label: str, seconds: float, error: float, metric: str = "depth, um", kind: str = "setting", **settings: object) -> Point:
    return Point(label, kind, settings, seconds, 1.0, {metric: error}, 1.5 * error)


def trade(stage: str, *points: Point) -> Trade:
    return Trade(stage, stage, 4, False, ("seconds",), points, {})


FEEL = trade(
    "feel", point("coarse", 1, 100), point("standard", 4, 10, kind="preset"), point("fine", 20, 0, depth=3), point("silly", 30, 50)
)
HOLD = trade("hold", point("standard", 10, 8, "missing, %", "preset"), point("fast", 2, 64, "missing, %"))
ONE = {"feel": 1, "hold": 1}


def test_of_all_combinations_within_the_time_the_one_with_the_least_product_of_errors_is_chosen(rng: np.random.Generator) -> None:
    for _ in range(50):
        trades = [
            trade(str(n), *(point(str(k), *np.exp(rng.uniform(0, 3, 2)).tolist()) for k in range(rng.integers(1, 5)))) for n in range(3)
        ]
        budget = float(rng.uniform(20, 200))
        pace = {"1": Pace(2.0, 5.0)}
        combinations = [
            (np.prod([one.error for one in row]), row)
            for row in itertools.product(*(one.points for one in trades))
            if sum(6 * one.seconds * (2 if n == 1 else 1) / 2 for n, one in enumerate(row)) + 5 <= budget
        ]
        if not combinations:
            with pytest.raises(AdviceError, match="fastest measured settings"):
                within_time(trades, pace, {"0": 6, "1": 6, "2": 6}, 2, budget)
            continue
        chosen = within_time(trades, pace, {"0": 6, "1": 6, "2": 6}, 2, budget)
        least = min(combinations, key=lambda entry: entry[0])[0]
        assert sum(one.seconds for one in chosen) <= budget
        assert np.prod([one.point.error for one in chosen]) <= least * 1.1  # the front takes 2 % apart for equal


def test_every_object_is_made_by_one_worker_and_packed_by_one_process():
    pace = {"feel": Pace(factor=2.0, start=3.0, packing=0.5)}
    (choice,) = fastest([FEEL], pace, {"feel": 5}, 2)
    assert choice.seconds == 3 + 2.0 * 1 * 3 + 5 * 0.5  # three rounds of two workers, a second and a kilobyte each
    (choice,) = fastest([FEEL], pace, {"feel": 1}, 16)
    assert choice.seconds == 3 + 2.0 + 0.5


def test_more_time_is_never_more_error():
    errors = [np.prod([max(one.point.error, 1) for one in within_time([FEEL, HOLD], {}, ONE, 1, time)]) for time in (4, 7, 15, 40)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > errors[-1]


def test_too_little_time_is_refused_with_what_it_takes():
    with pytest.raises(AdviceError, match=r"take 30 s, 5 s were given; take fewer objects"):
        within_time([FEEL, HOLD], {}, {"feel": 10, "hold": 10}, 1, 5)


def test_the_fastest_setting_within_an_error_and_the_preset_where_the_unit_is_another():
    chosen = within_error([FEEL, HOLD], {}, {"feel": 3, "hold": 3}, 1, Limit(20, "um"), "standard")
    assert [one.point.label for one in chosen] == ["standard", "standard"]
    assert [one.seconds for one in chosen] == [12, 30]
    assert within_error([FEEL], {}, ONE, 1, Limit(200, "um"), "standard")[0].point.label == "coarse"


def test_an_error_that_nothing_reaches_and_a_unit_that_nothing_has_are_refused():
    with pytest.raises(AdviceError, match=r"hold: missing, %, stays below 12 at best, 19 times in 20, not 1"):
        within_error([FEEL, HOLD], {}, ONE, 1, Limit(1, "%"), "standard")
    with pytest.raises(AdviceError, match=r"no stage is measured so.*feel in um, hold in %"):
        within_error([FEEL, HOLD], {}, ONE, 1, Limit(1, "kg"), "standard")


def test_assignments_name_what_stands_otherwise():
    fine = within_error([FEEL], {}, ONE, 1, Limit(0, "um"), "standard")[0]
    assert assignments(fine, {"depth": 1}) == ["feel.depth=3"]
    assert assignments(fine, {"depth": 3}) == []


def test_a_stage_that_looks_at_all_objects_at_once_takes_as_long_on_many_workers():
    learn = Trade("learn", "learn", 20, True, ("seconds",), (point("short", 100, 4), point("long", 300, 2)), {})
    for workers in (1, 8):
        chosen = within_time([learn], {"learn": Pace(0.5, 3)}, {"learn": 60}, workers, 200)
        assert [(one.point.label, one.seconds) for one in chosen] == [("short", 153)]


@pytest.mark.parametrize(("text", "seconds"), [("90s", 90), ("10min", 600), ("1.5 h", 5400)])
def test_times(text, seconds):
    assert duration(text) == seconds


@pytest.mark.parametrize("text", ["", "10", "min", "0s", "1..2s", "-3min", "10 days"])
def test_what_is_no_time(text):
    with pytest.raises(AdviceError, match="write 90s, 10min"):
        duration(text)


LIMITS = {
    "5um": Limit(5, "um"),
    "5 µm": Limit(5, "um"),
    "2%": Limit(2, "%"),
    "1e-3um": Limit(1e-3, "um"),
    "train-unet=400um": Limit(400, "um", "train-unet"),
    "train-gcn = 6": Limit(6, "", "train-gcn"),
}


@pytest.mark.parametrize("text", LIMITS)
def test_limits(text):
    assert error_limit(text) == LIMITS[text]


@pytest.mark.parametrize("text", ["", "um", "5", "1..2um", "train-unet="])
def test_what_is_no_limit(text):
    with pytest.raises(AdviceError, match="as 5um, 2%"):
        error_limit(text)


def test_a_limit_on_a_unit_of_several_stages_has_to_name_one():
    other = trade("other", point("standard", 1, 300, kind="preset"), point("fine", 9, 30))
    count = {"other": trade("other", point("few", 1, 30, "Chamfer"), point("standard", 2, 3, "Chamfer", "preset"))}
    with pytest.raises(AdviceError, match=r"several stages are measured so; say which.*feel in um, other in um"):
        within_error([FEEL, other], {}, {"feel": 1, "other": 1}, 1, Limit(20, "um"), "standard")
    chosen = within_error([FEEL, other], {}, {"feel": 1, "other": 1}, 1, Limit(50, "um", "other"), "standard")
    assert [one.point.label for one in chosen] == ["standard", "fine"]
    assert within_error([count["other"]], {}, {"other": 1}, 1, Limit(50, "", "other"), "standard")[0].point.label == "few"
    with pytest.raises(AdviceError, match="other is measured in a number without unit"):
        within_error([count["other"]], {}, {"other": 1}, 1, Limit(50, "um", "other"), "standard")


def test_the_fastest_of_every_stage():
    assert [one.point.label for one in fastest([FEEL, HOLD], {}, ONE, 1)] == ["coarse", "fast"]


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("trained", [False, True])
def test_nineteen_other_data_sets_in_twenty_stay_below_the_bound(power, trained, rng: np.random.Generator) -> None:
    """Objects differ, and so do trainings: ten objects, four trainings."""

    def data_set(trainings: int) -> tuple[np.ndarray, np.ndarray]:
        each = rng.gamma(9.0, 1.0, 10)
        luck = 1 + 0.15 * rng.normal(size=trainings) * trained
        return each * luck[0], np.mean(each**power) ** (1 / power) * luck

    kept = 0
    for _ in range(1000):
        each, trainings = data_set(4)
        bound = Errors({"error": trainings[0]}, list(each), power).bound(list(trainings) if trained else [])
        kept += data_set(1)[1][0] <= bound
    assert 0.9 <= kept / 1000 <= 0.985  # squares of few objects are skew


def test_a_share_of_no_touch_in_two_hundred_may_be_three_of_them():
    assert Errors({"missing, %": 0.0}, [0.0] * 10, touches=200).bound([]) == 1.5
    assert Errors({"missing, %": 60.0}, [0.0, 100.0, 100.0], touches=60).bound([]) == 100
