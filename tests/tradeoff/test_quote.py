"""What `run --explain` quotes of measured errors."""

from __future__ import annotations

import pytest

from pipeline.tradeoff import quote as quoting
from pipeline.tradeoff.quote import quote
from stages.registry import resolve
from tests.tradeoff.studies import measurement, study

SOURCE = "[commit abc1234, 2026-01-31; the code has changed since]"
VISION = {"resolution": 256, "occluded": True}


def settings(stage: str, *assignments: str):
    return resolve(stage, "standard", assignments)


@pytest.fixture
def figures(monkeypatch):
    standard = settings("render-vision").accuracy()
    network = settings("train-gcn").accuracy()
    made = [
        study(
            "render-vision",
            measurement("draft, standard", 4, 5, kind="preset", **standard),
            measurement("resolution=128", 2, 8, **{**standard, "resolution": 128}),
            measurement("resolution=512", 8, 3, **{**standard, "resolution": 512}),
            varied_at={"occluded": False},
        ),
        study("train-gcn", measurement("standard", 1, 2, kind="preset", **network), fixed={"configuration": "touch"}),
    ]
    monkeypatch.setattr(quoting, "load_studies", lambda: {one.name: one for one in made})


@pytest.mark.usefixtures("figures")
def test_measured_settings_are_quoted_with_commit():
    assert quote("render-vision", settings("render-vision")) == f"measured at these settings: depth, um: 5 {SOURCE}"


@pytest.mark.usefixtures("figures")
def test_measured_settings_are_compared_with_standard():
    said = quote("render-vision", settings("render-vision", "resolution=128"))
    assert said == f"measured at these settings: depth, um: 8 (standard 5, 2 × the time) {SOURCE}"


@pytest.mark.usefixtures("figures")
def test_unmeasured_value_is_quoted_with_its_neighbours():
    said = quote("render-vision", settings("render-vision", "resolution=200"))
    assert said == (
        f"not measured at these settings; one by one at occluded=False, depth, um: resolution=200: not measured (128: 8, 512: 3) {SOURCE}"
    )


@pytest.mark.usefixtures("figures")
def test_another_network_is_quoted_with_the_measured_one():
    seeing, touching = (quote("train-gcn", settings("train-gcn", f"configuration={name}")) for name in ("unoccluded", "touch"))
    assert seeing.startswith("measured at these settings, with configuration=touch: depth")
    assert touching.startswith("measured at these settings: depth")


@pytest.mark.usefixtures("figures")
def test_stage_without_a_study_is_not_quoted():
    assert quote("evaluate", settings("evaluate")) == ""
