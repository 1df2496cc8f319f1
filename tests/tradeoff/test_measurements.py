"""Measurements: the front, the settings they belong to, and whether the code is still the measured one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline.engine.keys import code_hash
from pipeline.tradeoff.measurements import load_studies
from stages.registry import STAGES, load_stage, resolve
from tests.tradeoff.studies import MADE, measurement, study


def test_front_holds_what_no_other_beats_by_more_than_noise():
    measured = study(
        "a",
        *(measurement("cheap", 1, 9), measurement("dear", 8, 1), measurement("as dear", 9, 1), measurement("beaten", 10, 2)),
        *(measurement("exact", 20, 0), measurement("noise", 0.1, 0.1, kind="seed")),
    )
    assert [one.label for one in measured.front()] == ["cheap", "dear", "as dear", "exact"]
    assert (measured.metric, measured.unit) == ("depth, um", "um")


def test_front_of_two_costs_keeps_the_smaller_output():
    large, small = measurement("large", 1, 1), replace(measurement("small", 2, 1), kilobytes=0.5)
    assert study("a", large, small).front() == [large]
    assert replace(study("a", large, small), costs=("seconds", "kilobytes")).front() == [large, small]


def test_preset_is_found_in_a_label_of_several():
    both = measurement("draft, standard", 1, 1, kind="preset")
    assert both.is_preset("standard")
    assert not both.is_preset("stand")
    assert not measurement("standard", 1, 1).is_preset("standard")


def test_study_names_fixed_settings_that_differ():
    measured = study("render-vision", measurement("standard", 1, 1), fixed={"scene": "other"})
    assert measured.fixed_otherwise(resolve("render-vision", "standard", [])) == ", with scene=other"
    assert measured.fixed_otherwise(resolve("render-vision", "standard", ["scene=other"])) == ""


@pytest.mark.parametrize(("code", "current"), [(None, False), ("of another commit", False), ("", True)])
def test_study_is_current_only_under_the_code_it_was_measured_on(code, current):
    code = code_hash(load_stage("render-vision")) if code == "" else code
    measured = replace(study("render-vision", measurement("standard", 1, 1)), provenance=replace(MADE, code=code))
    assert measured.is_current() == current
    assert measured.source() == "commit abc1234, 2026-01-31" + ("" if current else "; the code has changed since")


def test_committed_figures_can_be_read():
    for name, measured in load_studies().items():
        assert measured.name == name
        assert measured.stage in STAGES
        assert measured.provenance.commit
        assert measured.front()
