"""The stage: rows as the schema declares them, and objects that cannot be grasped."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.contrib.toy_objects.source import MAKERS, generate
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.engine.stage import Unit
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import normalise_mesh
from pipeline.physics.hold_test import is_held
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from schemas.base import COMMON, FIXED
from schemas.grasps import GRASPS
from stages.simulate_grasps.stage import GraspSettings, SimulateGrasps
from tests.kernels.hand.meshes import bar, centred, points_on
from tests.stages import ball_dataset
from tests.stages.simulate_grasps.conftest import SETTINGS


def unit_of(mesh: Mesh, points: np.ndarray, normals: np.ndarray) -> tuple[Unit, dict[str, Any]]:
    surfaces = {"points": points.astype(np.float32), "normals": normals.astype(np.float32), **mesh_row(mesh)}
    return Unit("thing"), {"surfaces": surfaces}


@pytest.mark.parametrize("hold_test", ["none", "lift", "six"])
def test_row_has_the_arrays_of_the_schema(hold_test: str) -> None:
    settings = SETTINGS.model_copy(update={"attempts": 3, "grasps": 2, "hold_test": hold_test})
    with SimulateGrasps().session(settings, {}) as process:
        row = process(*unit_of(bar(), *points_on(bar(), 1000, seed=3)))
    sizes = {"grasp": 2, "sensor": 4, "joint": 16, "direction": 6 if hold_test == "six" else 1, **FIXED}
    declared = {name: array for name, array in GRASPS.arrays.items() if name not in COMMON and array.dims[0] == "object"}
    lift = {"held", "hold_distance", "hold_speed"}
    tested = {"none": set(), "lift": lift, "six": lift | {"held_directions"}}[hold_test]
    declared = {name: array for name, array in declared.items() if name in tested or not array.optional}
    assert set(row) == set(declared)
    for name, array in declared.items():
        assert row[name].dtype == np.dtype(array.dtype), name
        assert row[name].shape == tuple(sizes[dim] for dim in array.dims[1:]), name
    if tested:
        stays = is_held(row["hold_distance"], row["hold_speed"])
        np.testing.assert_array_equal(row["held"], stays[:, 4 if hold_test == "six" else 0])
        np.testing.assert_array_equal(row.get("held_directions", stays), stays)


@pytest.mark.parametrize(("hand", "size"), [("allegro_right", (0.05, 0.06, 0.12)), ("two_finger_gripper", (0.03, 0.03, 0.1))])
def test_hold_search_keeps_grasps_that_oppose_each_other_and_hold(hand: str, size: tuple[float, float, float]) -> None:
    box = centred(trimesh.creation.box(size))
    settings = GraspSettings(hand=hand, search="hold", grasps=1, ik_samples=512)
    with SimulateGrasps().session(settings, {}) as process:
        rows = [process(*unit_of(box, *points_on(box, 2000, seed=3))) for _ in range(2)]
    row = rows[0]
    assert row["held"].all()
    assert is_held(row["hold_distance"], row["hold_speed"]).all()
    assert row["opposition"].min() > 150
    assert row["closure"].min() > 0
    touched = row["touch_success"]
    from_faces = np.sort(np.abs(np.abs(row["contact_point"] - [0, 0, 0.6]) - np.array(size) / 2), axis=2)
    at_edge = from_faces[..., 1] < 2e-3  # the middle of a contact that is bent around an edge lies below it
    assert from_faces[touched & ~at_edge, 0].max() < 5e-4  # contact points lie on the box, their normals point into it
    assert from_faces[touched, 0].max() < 1e-3
    assert ((row["contact_normal"] * (row["contact_point"] - [0, 0, 0.6])).sum(axis=2)[touched] < 0).all()
    assert not row["contact_point"][~touched].any()
    assert (row["pregrasp_angles"] != row["squeeze_angles"]).any()
    for name, array in row.items():
        np.testing.assert_array_equal(rows[1][name], array)


def test_hold_search_touches_objects_that_the_hand_cannot_span_and_makes_all_attempts_for_the_best_score() -> None:
    block = centred(trimesh.creation.box((0.5, 0.5, 0.5)))
    settings = SETTINGS.model_copy(update={"search": "hold", "attempts": 2, "grasps": 1, "prefer": "area"})
    with SimulateGrasps().session(settings, {}) as process:
        row = process(*unit_of(block, *points_on(block, 1000, seed=3)))
    assert row["attempts"] == 2
    assert row["touch_success"].any()
    assert not row["held"].any()


def test_early_stop_keeps_the_same_grasps() -> None:
    rows = []
    for exhaustive in (True, False):
        settings = SETTINGS.model_copy(update={"attempts": 6, "grasps": 2, "exhaustive": exhaustive})
        with SimulateGrasps().session(settings, {}) as process:
            rows.append(process(*unit_of(bar(), *points_on(bar(), 1000, seed=3))))
    assert rows[1]["attempts"] <= rows[0]["attempts"] == 6
    for name in ("hand_pose", "joint_angles", "sensor_pose", "touch_success", "penetration"):
        np.testing.assert_array_equal(rows[1][name], rows[0][name])


@pytest.mark.slow
@pytest.mark.parametrize("category", MAKERS)
def test_kept_grasps_touch_with_most_sensors_at_standard_settings(category: str) -> None:
    mesh, _ = normalise_mesh(generate(category, numpy_rng(5, category)), up="z", diagonal=0.5)
    points, normals = sample_exterior(mesh, 10_000, numpy_rng(6, category))
    with SimulateGrasps().session(GraspSettings(exhaustive=True), {}) as process:
        row = process(*unit_of(mesh, points, normals))
    assert row["attempts"] == 50
    assert row["touch_success"].mean() >= 0.85
    assert row["touch_success"][:, 3].mean() >= 0.6
    assert row["attempt_success"].mean() >= 0.5
    assert row["penetration"].max() <= 1e-3


def test_grasps_without_any_touch_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ball_dataset, "touched", lambda unit, grasp, sensor: unit.name != "b" or grasp in (0, 3))
    ball_dataset.make_data(tmp_path, 3)
    (shard,) = DataDirectory(tmp_path).collection(GRASPS).shards
    (line,) = SimulateGrasps().describe_shard(GraspSettings(), shard)
    assert line.startswith("3 grasps of 1 object (b) kept without any touch")


@pytest.mark.parametrize(
    ("outward", "changes", "fault"),
    [
        (-1, {}, "the hand has no room"),  # points on the inner side of a hollow ball: the palm fits nowhere
        (1, {"settle_steps": 20}, r"fingers still move after 20 steps \(simulate-grasps.settle_steps\)"),
    ],
)
def test_object_without_a_grasp_is_refused_with_the_reason(outward: int, changes: dict[str, Any], fault: str) -> None:
    ball = centred(trimesh.creation.icosphere(subdivisions=2, radius=0.05))
    points, normals = points_on(ball, 100, seed=0)
    settings = SETTINGS.model_copy(update={"grasps": 1, "attempts": 2, **changes})
    error = pytest.raises(InvalidInput, match=f"0 of 1 grasps found in 2 attempts: {fault}")
    with SimulateGrasps().session(settings, {}) as process, error:
        process(*unit_of(ball, points, outward * normals))
