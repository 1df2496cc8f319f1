"""Choosing among measured settings: what fits a time or an error, and what is said where nothing does."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.tradeoff.choice import Choice, Limit, MachineSpeed, Workload, duration, error_limit, within_error, within_time
from tests.tradeoff.studies import measurement, study

FEEL = study(
    "feel",
    *(measurement("coarse", 1, 100), measurement("standard", 4, 10, kind="preset")),
    *(measurement("fine", 20, 0, depth=3), measurement("silly", 30, 50)),
)
HOLD = study("hold", measurement("standard", 10, 8, metric="missing, %", kind="preset"), measurement("fast", 2, 64, metric="missing, %"))
ONE = Workload({"feel": 1, "hold": 1, "other": 1}, workers=1)


def labels(choices):
    return [choice.measurement.label for choice in choices]


def test_within_time_finds_the_least_product_of_errors_of_all_combinations(rng: np.random.Generator) -> None:
    for _ in range(50):
        studies = [
            study(str(n), *(measurement(str(k), *np.exp(rng.uniform(0, 3, 2)).tolist()) for k in range(rng.integers(1, 5))))
            for n in range(3)
        ]
        budget = float(rng.uniform(20, 200))
        workload = Workload({"0": 6, "1": 6, "2": 6}, 2, {"1": MachineSpeed(2.0, 5.0)})
        combinations = [
            (np.prod([one.error for one in row]), row)
            for row in itertools.product(*(one.measurements for one in studies))
            if sum(6 * one.seconds * (2 if n == 1 else 1) / 2 for n, one in enumerate(row)) + 5 <= budget
        ]
        if not combinations:
            with pytest.raises(InvalidInput, match="fastest measured settings"):
                within_time(studies, workload, budget)
            continue
        chosen = within_time(studies, workload, budget)
        least = min(combinations, key=lambda entry: entry[0])[0]
        assert sum(one.seconds for one in chosen) <= budget
        assert np.prod([one.measurement.error for one in chosen]) <= least * 1.1  # the front takes 2 % apart for equal


def test_objects_are_shared_by_workers_and_packed_by_one_process():
    speed = {"feel": MachineSpeed(factor=2.0, startup=3.0, publishing=0.5)}
    choice = Workload({"feel": 5}, 2, speed).choice(FEEL, FEEL.measurements[0])
    assert choice.seconds == 3 + 2.0 * 1 * 3 + 5 * 0.5  # three rounds of two workers; a second and a kilobyte per object
    choice = Workload({"feel": 1}, 16, speed).choice(FEEL, FEEL.measurements[0])
    assert choice.seconds == 3 + 2.0 + 0.5


def test_more_time_never_gives_more_error():
    errors = [np.prod([max(one.measurement.error, 1) for one in within_time([FEEL, HOLD], ONE, time)]) for time in (4, 7, 15, 40)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > errors[-1]


def test_too_little_time_is_refused_with_the_time_it_takes():
    tried = Workload({"feel": 10, "hold": 10}, 1, {"feel": MachineSpeed(), "hold": MachineSpeed()})
    with pytest.raises(InvalidInput, match=r"take 30 s, 5 s were given; take fewer objects"):
        within_time([FEEL, HOLD], tried, 5)


def test_too_little_time_gives_the_fastest_of_every_stage_before_this_machine_is_tried():
    assert labels(within_time([FEEL, HOLD], Workload({"feel": 10, "hold": 10}, 1), 5)) == ["coarse", "fast"]


def test_within_error_takes_the_fastest_setting_and_the_preset_for_other_units():
    chosen = within_error([FEEL, HOLD], Workload({"feel": 3, "hold": 3}, 1), Limit(20, "um"))
    assert labels(chosen) == ["standard", "standard"]
    assert [one.seconds for one in chosen] == [12, 30]
    assert labels(within_error([FEEL], ONE, Limit(200, "um"))) == ["coarse"]


def test_unreachable_error_and_unknown_unit_are_refused():
    with pytest.raises(InvalidInput, match=r"hold: missing, %, stays below 12 at best, 19 times in 20, not 1"):
        within_error([FEEL, HOLD], ONE, Limit(1, "%"))
    with pytest.raises(InvalidInput, match=r"no stage is measured so.*feel in um, hold in %"):
        within_error([FEEL, HOLD], ONE, Limit(1, "kg"))


def test_assignments_name_what_differs_from_the_preset():
    touch = study("simulate-touch", measurement("rounded", 1, 1, gel_bits=24, far_bits=None), measurement("standard", 2, 1, tracer="ray"))
    rounded, standard = (Choice(touch, one, 1.0).assignments() for one in touch.measurements)
    assert rounded == ["simulate-touch.gel_bits=24", "simulate-touch.far_bits=null"]
    assert standard == []


@pytest.mark.parametrize("workers", [1, 8])
def test_stage_over_the_whole_dataset_gains_nothing_from_workers(workers):
    learn = study("learn", measurement("short", 100, 4), measurement("long", 300, 2), objects=20, whole_dataset=True)
    chosen = within_time([learn], Workload({"learn": 60}, workers, {"learn": MachineSpeed(0.5, 3)}), 200)
    assert labels(chosen) == ["short"]
    assert chosen[0].seconds == 153


@pytest.mark.parametrize(("text", "seconds"), [("90s", 90), ("10min", 600), ("1.5 h", 5400)])
def test_duration_is_parsed(text, seconds):
    assert duration(text) == seconds


@pytest.mark.parametrize("text", ["", "10", "min", "0s", "1..2s", "-3min", "10 days"])
def test_other_text_is_no_duration(text):
    with pytest.raises(InvalidInput, match="write 90s, 10min"):
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
def test_error_limit_is_parsed(text):
    assert error_limit(text) == LIMITS[text]


@pytest.mark.parametrize("text", ["", "um", "5", "1..2um", "train-unet="])
def test_other_text_is_no_error_limit(text):
    with pytest.raises(InvalidInput, match="as 5um, 2%"):
        error_limit(text)


def test_limit_on_a_unit_of_several_stages_must_name_one():
    other = study("other", measurement("standard", 1, 300, kind="preset"), measurement("fine", 9, 30))
    with pytest.raises(InvalidInput, match=r"several stages are measured so; say which.*feel in um, other in um"):
        within_error([FEEL, other], ONE, Limit(20, "um"))
    assert labels(within_error([FEEL, other], ONE, Limit(50, "um", "other"))) == ["standard", "fine"]


def test_limit_without_unit_applies_to_a_stage_measured_without_one():
    count = study("other", measurement("few", 1, 30, metric="Chamfer"), measurement("standard", 2, 3, metric="Chamfer", kind="preset"))
    assert labels(within_error([count], ONE, Limit(50, "", "other"))) == ["few"]
    with pytest.raises(InvalidInput, match="other is measured in a number without unit"):
        within_error([count], ONE, Limit(50, "um", "other"))
