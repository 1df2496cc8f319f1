"""The figures that came of `make tradeoff`: whole, of today's settings, and read right."""

from __future__ import annotations

import pytest

from benchmarks.tradeoff.variants import studies
from pipeline.config.presets import load_presets, resolve
from pipeline.tuning.tradeoff import Point, Trade, in_words, load_trades
from stages.registry import STAGES, load_settings_type, load_stage

UNMEASURED = {
    "train-unet": {"loss_points"},  # of the other loss: measured together with it
    "simulate-touch": {"sphere_tolerance", "sphere_steps"},  # of the other tracer, likewise
    "fit-charts": {"device"},  # needs a GPU
    "evaluate": set(),
}


@pytest.mark.parametrize("stage", STAGES)
def test_every_setting_that_changes_results_is_varied(stage):
    varied = {setting for study in studies() if study.stage == stage for setting in study.settings}
    together = {setting for study in studies() if study.stage == stage for values in study.together for setting in values}
    wanted = {setting for setting in load_settings_type(stage).model_fields if load_settings_type(stage).changes(setting) == "results"}
    assert wanted == varied | (UNMEASURED.get(stage, set()) & wanted)
    assert UNMEASURED.get(stage, set()) - {"device"} <= together


STUDIES = {study.name: study for study in studies()}


def test_every_study_was_measured():
    assert list(load_trades()) == list(STUDIES)


@pytest.mark.parametrize("name", STUDIES)
def test_what_was_measured_is_what_is_varied(name):
    measured, study = load_trades()[name], STUDIES[name]
    assert [point.label for point in measured.points] == [variant.label for variant in study.variants()]
    for point, variant in zip(measured.points, study.variants(), strict=True):
        assert point.settings == variant.settings(study.stage).accuracy()
        assert point.seconds > 0
        assert 0 <= point.error <= point.bound


@pytest.mark.parametrize("name", [name for name, study in STUDIES.items() if name == study.stage])
def test_three_settings_are_beaten_by_none(name):
    assert len(load_trades()[name].front()) >= 3


BEATEN = {
    "sample-surfaces": {"draft", "standard", "paper"},  # 256 directions are part of what an exterior point is
    "simulate-touch": {"paper"},  # the supplement's sphere tracing,
    "fit-charts": {"paper"},  # and its steps
}
"""Presets that another setting beats by far, and what prescribes them."""


@pytest.mark.parametrize("name", STUDIES)
def test_presets_lie_near_the_front_unless_prescribed(name):
    trade = load_trades()[name]
    assert {preset for preset in load_presets() if not trade.is_near_front(preset)} == BEATEN.get(name, set())


@pytest.mark.parametrize("name", STUDIES)
@pytest.mark.parametrize("preset", load_presets())
def test_a_run_says_what_its_preset_costs_in_error(name, preset):
    trade = load_trades()[name]
    words = in_words(trade.stage, resolve(load_stage(trade.stage), preset, [], STAGES))
    assert words.startswith("measured at these settings") or preset in trade.skipped


def test_settings_that_were_not_measured_are_told_apart_setting_by_setting():
    words = in_words("simulate-grasps", resolve(load_stage("simulate-grasps"), "standard", ["grid_cell=0.01", "clearance=0.002"], STAGES))
    assert words.startswith("not measured at these settings; one by one at attempts=12, touches missing or unsound, %: clearance=0.002: ")
    assert "grid_cell=0.01: " in words


def test_a_network_that_was_not_trained_is_told_which_was():
    seeing, feeling = (
        in_words("train-gcn", resolve(load_stage("train-gcn"), "draft", [f"configuration={name}"], STAGES))
        for name in ("unoccluded", "touch")
    )
    assert seeing.startswith(
        ("measured at these settings, with configuration=touch:", "measured at these settings, with configuration=occ")
    )
    assert feeling.startswith("measured at these settings: Chamfer")


def test_a_stage_that_was_not_measured_says_nothing(monkeypatch):
    monkeypatch.setattr("pipeline.tuning.tradeoff.load_trades", lambda: {})
    assert in_words("evaluate", load_settings_type("evaluate")()) == ""


def test_the_front_holds_what_none_beats_by_more_than_noise():
    def point(label: str, seconds: float, error: float, kind: str = "setting") -> Point:
        return Point(label, kind, {}, seconds, 1.0, {"depth, um": error}, error)

    points = (
        *(point("cheap", 1, 9), point("dear", 8, 1), point("as dear", 9, 1), point("beaten", 10, 2)),
        *(point("exact", 20, 0), point("noise", 0.1, 0.1, "seed")),
    )
    trade = Trade("a", "a", 1, False, ("seconds",), points, {})
    assert [one.label for one in trade.front()] == ["cheap", "dear", "as dear", "exact"]
    assert (trade.metric, trade.unit) == ("depth, um", "um")
