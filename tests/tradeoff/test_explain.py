"""`run STAGE --explain`, of all stages, on a tiny dataset: the counts are those of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from pkgutil import iter_modules
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from benchmarks.tradeoff import shortcuts_data, shortcuts_learning
from pipeline.cli import app
from pipeline.cli import run as command
from pipeline.console import console
from pipeline.engine.plan import Plan, Request
from pipeline.engine.run import make_plans, run
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff import explanations
from pipeline.tradeoff.explain import Count, Explanation, arrays_read, explain_plan, processed_units, total
from schemas.base import COMMON, COORDINATES
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from stages.registry import GRASP_STAGES, load_stage
from stages.sample_surfaces.settings import SurfaceSettings
from tests.stages.tiny_dataset import ASSIGNMENTS, manifest

SETS = [
    *ASSIGNMENTS,
    *("train-unet.width=2", "train-unet.epochs=1", "fit-charts.max_iterations=5", "train-gcn.epochs=1", "train-gcn.gcn_layers=3"),
    *("train-gcn.gcn_features=12", "train-gcn.encoder_width=0.25", "train-gcn.loss_points=300", "evaluate.points=500"),
    *("evaluate.configurations=[touch]", "train-gcn.configuration=touch", "train-implicit.epochs=1", "simulate-grasps.attempts=5"),
]
OBJECTS, SENSORS = 3, 20
Explained = dict[str, list[Count]]

EXPLAINED = {module.name for module in iter_modules(explanations.__path__)}
"""The stages that count what they left out."""


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("explained")


@pytest.fixture(scope="module")
def explained(data) -> Explained:
    """Make every stage, and what it then says of itself."""
    source = {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": OBJECTS}}
    splits = {"train": 1, "valid": 1, "test": 1}
    manifest = data / "tiny.yaml"
    manifest.write_text(yaml.safe_dump({"name": "tiny", "description": "d", "seed": 0, "splits": splits, "sources": [source]}))
    sets = [part for assignment in SETS for part in ("--set", assignment)]
    found: Explained = {}

    def explain_and_keep(plan: Plan[Any]) -> Explanation | None:
        explanation = explain_plan(plan)
        assert explanation is not None
        found[plan.stage.name] = list(explanation.counts)
        return explanation

    with patch.object(command, "explain_plan", explain_and_keep):
        for stage in GRASP_STAGES:
            asked = ["run", stage, "--manifest", str(manifest), "--data", str(data), "--workers", "1", "--explain", *sets]
            result = CliRunner().invoke(app, asked)
            assert result.exit_code == 0, result.output
            assert "why it was left out" in result.output
    return found


def of(parts: list[Count], what: str, shortcut: str = "") -> Count:
    (found,) = (part for part in parts if part.what == what and part.shortcut == shortcut)
    return found


def rows(data: Path, artifact) -> Iterator:
    collection = DataDirectory(data).collection(artifact)
    return (collection.view(object_id) for object_id in collection)


def test_every_stage_leaves_something_out_and_names_measured_shortcuts(explained):
    assert list(explained) == list(GRASP_STAGES)
    named = {part.shortcut for parts in explained.values() for part in parts} - {""}
    measured = (*shortcuts_data.shortcuts(shortcuts_data.Bench(1, 8)), *shortcuts_learning.shortcuts(shortcuts_learning.Bench()))
    assert named <= {one.name for one in measured}
    for stage, parts in explained.items():
        assert any(part.left_out for part in parts) == (stage.replace("-", "_") in EXPLAINED), stage
        assert all(part.modelled >= 0 and part.left_out >= 0 and part.why for part in parts), stage


def test_points_of_surfaces_add_up(explained):
    parts = explained["sample-surfaces"]
    points = of(parts, "points of the surface")
    assert points.modelled + points.left_out == OBJECTS * 2000
    assert points.modelled > 0


def test_attempts_of_grasps_equal_those_of_the_rows(explained, data):
    parts = explained["simulate-grasps"]
    assert of(parts, "attempts", "enough attempts").modelled == sum(int(row["attempts"]) for row in rows(data, GRASPS))
    spheres = of(parts, "spheres measured exactly", "doubtful spheres")
    assert 0 < spheres.modelled < spheres.left_out


def test_images_and_hand_shapes_are_counted(explained):
    parts = explained["render-vision"]
    assert (of(parts, "images").modelled, of(parts, "images").left_out) == (OBJECTS * 6, 0)


def test_sensors_and_tactile_images_equal_those_of_the_depths(explained, data):
    parts = explained["simulate-touch"]
    depth = np.concatenate([row["depth"].reshape(-1, 100, 100) for row in rows(data, TOUCH)])
    assert of(parts, "sensors traced").modelled >= int(np.isfinite(depth).any(axis=(1, 2)).sum())
    stored = of(parts, "local points stored")
    assert (stored.modelled, stored.left_out) == (0, OBJECTS * SENSORS * 10_000)


def test_only_successful_touches_are_learned_from_and_fitted(explained, data):
    touched = [int(row["touch_success"].sum()) for row in rows(data, GRASPS)]
    charts = of(explained["fit-charts"], "charts fitted")
    assert (charts.modelled, charts.modelled + charts.left_out) == (sum(touched), OBJECTS * SENSORS)
    assert of(explained["fit-charts"], "steps").modelled == sum(int(row["iterations"].sum()) for row in rows(data, CHARTS))
    learnt = of(explained["train-unet"], "tactile images learnt from")
    assert learnt.modelled + learnt.left_out == 2 * SENSORS  # train and valid


def test_network_with_touch_alone_opens_no_images(explained):
    parts = explained["train-gcn"]
    assert of(parts, "arrays read").modelled == 3  # points, vertices, stop_rule
    pairs = of(parts, "pairs of vertices averaged, per item", "sparse neighbours")
    assert pairs.modelled + pairs.left_out == (1824 + 20 * 81) ** 2


def test_reconstructions_are_counted_once_per_case(explained):
    made = of(explained["evaluate"], "reconstructions", "each case once")
    assert (made.modelled, made.left_out) == (21, 4)


def test_equal_counts_are_added_up_in_order():
    parts = [Count("a", 1, 2, "w"), Count("b", 1, 0, "w"), Count("a", 3, 4, "w"), Count("a", 1, 1, "other")]
    assert total(parts) == [Count("a", 4, 6, "w"), Count("b", 1, 0, "w"), Count("a", 1, 1, "other")]


def test_arrays_that_are_not_read_are_left_out():
    count = arrays_read(["points"], [SURFACES])
    assert count.modelled == 1
    assert count.left_out == len(SURFACES.arrays) - len({*COMMON, *COORDINATES} & set(SURFACES.arrays)) - 1


def test_one_object_is_explained_where_its_shard_lacks_the_others(tmp_path):
    asked = ["run", "sample-surfaces", "--data", str(tmp_path), "--object", "duck", "--shards", "2", "--set", "points=100", "--explain"]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 0, result.output
    assert result.output.count("counted on 1 of") == 1
    assert "objects (duck)" in result.output


def test_explanation_is_of_what_was_just_made(tmp_path):
    objects, stage = manifest().objects(), load_stage("sample-surfaces")
    for points, only in ((100, None), (150, objects[0].object_id)):
        (plan,) = make_plans(Request(stage, SurfaceSettings(points=points), "tiny", objects, "draft", 0, tmp_path, only=only))
        run(plan, console)
    ((_, inputs),) = processed_units(plan)
    assert len(inputs["surfaces"]["points"]) == 150
