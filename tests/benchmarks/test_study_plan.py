"""The studies of `make tradeoff`, what of them is missing, and the page that is written."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.provenance import provenance
from benchmarks.tradeoff.missing import unmeasured
from benchmarks.tradeoff.page import study_section
from benchmarks.tradeoff.study_plan import StudyPlan, study_plans
from tests.tradeoff.studies import measurement, study

PLAN = StudyPlan(
    name="render-vision",
    stage="render-vision",
    objects="few",
    base="standard",
    settings={"resolution": [64, 128]},
    combinations=[{"resolution": 64, "occluded": False}],
    reference={"resolution": 1024},
    skipped={"paper": "takes long"},
    seeds=(1,),
)


@pytest.mark.parametrize("plan", study_plans(), ids=lambda plan: plan.name)
def test_described_studies_name_settings_that_exist(plan):
    assert plan.manifest.is_file()
    assert plan.variants()


def test_presets_of_equal_settings_are_one_variant():
    labels = [variant.label for variant in PLAN.variants()]
    assert labels == ["draft, standard", "resolution=64", "resolution=128", "resolution=64 occluded=false", "seed 1"]


def test_reference_has_another_seed():
    reference = PLAN.reference_variant()
    assert reference.seed
    assert reference.settings("render-vision").resolution == 1024


def test_two_variants_of_one_label_are_refused():
    alike = replace(PLAN, combinations=[{"resolution": 64}], varied_at={"occluded": False})
    with pytest.raises(ValueError, match="two variants have one label"):
        alike.variants()


def test_missing_lists_settings_variants_and_studies_of_other_code():
    values = {variant.label: variant.settings("render-vision").accuracy() for variant in PLAN.variants()}
    made = [
        measurement("draft, standard", 4, 5, kind="preset", **values["draft, standard"]),
        measurement("resolution=64", 1, 9, **(values["resolution=64"] | {"resolution": 65})),
    ]
    lines = list(unmeasured([PLAN], {"render-vision": study("render-vision", *made)}))
    assert "simulate-grasps.attempts: varied by no study" in lines
    assert "render-vision, resolution=64: not measured at these settings" in lines
    assert "render-vision, resolution=128: not measured at these settings" in lines
    assert "render-vision: measured at commit abc1234, 2026-01-31; the code has changed since" in lines
    assert not [line for line in lines if "draft" in line or "render-vision.resolution" in line]
    assert "render-vision: not measured" in list(unmeasured([PLAN], {}))


def test_the_command_of_a_measurement_can_be_run_again(monkeypatch):
    monkeypatch.setattr("sys.argv", ["big_run", "--data", "a 'b'; c"])
    assert shlex.split(provenance("", "python -m benchmarks.big_run")["command"])[-1] == "a 'b'; c"


def test_page_of_a_study_gives_its_provenance_and_its_front():
    measured = [measurement("draft", 1, 5, kind="preset"), measurement("width=4", 2, 8), measurement("width=8", 3, 4)]
    made = study("train-unet", *measured, skipped={"paper": "takes days"})
    text = study_section(made, Path("train-unet.png"))
    assert "4 objects. `make tradeoff`, commit abc1234, a machine, 2026-01-31." in text
    assert "| • | **draft** | 1 | 1 | 5 | 7.5 |" in text
    assert "| • | `width=8` | 3 | 1 | 4 | 6 |" in text
    assert "width=4" not in text, "beaten by draft"
    assert "Not measured as a whole: `paper` (takes days)." in text
