"""Grasps from placement to measurement: sound by means that did not choose them, and the same every time."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from pipeline.engine.stage import Task
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.kernels.hand.kinematics import forward, sensor_poses
from pipeline.rng import numpy_rng
from pipeline.toy_objects import CATEGORIES, generate
from schemas.base import COMMON
from schemas.grasps import GRASPS
from stages.simulate_grasps.attempt import Grasp, attempt, keep_best
from stages.simulate_grasps.physics import Simulation, simulation
from stages.simulate_grasps.rig import Rig, Scene, make_rig, make_scene
from stages.simulate_grasps.settings import GraspSettings
from stages.simulate_grasps.stage import SimulateGrasps
from tests.grasps.conftest import SETTINGS, bar, mug, placed, points_on

Grasped = list[tuple[Mesh, Scene, list[Grasp]]]
TryAt = Callable[[Simulation, Mesh, int], Grasp | None]


def test_there_are_sound_grasps_that_touch(grasped: Grasped) -> None:
    for _, _, grasps in grasped:
        assert len(grasps) >= 3
        assert max(grasp.touched.sum() for grasp in grasps) >= 3


def test_touches_are_there_to_see(rig: Rig, grasped: Grasped) -> None:
    """Rays of trimesh's own from a few pixels of every sensor, over float32 Embree: a touch is something within the gel."""
    spots = (np.arange(24) + 0.5) / 24 * rig.sensor.width - rig.sensor.width / 2
    x, y = (axis.ravel() for axis in np.meshgrid(spots, spots))
    for mesh, _, grasps in grasped:
        body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        for grasp in grasps:
            for pose, touched in zip(grasp.sensor_pose, grasp.touched, strict=True):
                origins = np.stack([x, y, np.zeros_like(x)], axis=1) @ pose[:3, :3].T + pose[:3, 3]
                hits, rays, _ = body.ray.intersects_location(origins, np.tile(pose[:3, 2], (len(x), 1)), multiple_hits=False)
                nearest = np.linalg.norm(hits - origins[rays], axis=1).min(initial=np.inf)
                if touched:
                    assert 0 < nearest < rig.sensor.w + 5e-4  # 24² rays pass by what 100² see
                else:
                    assert nearest > rig.sensor.w - 2e-4


def test_joints_keep_their_limits_and_poses_follow_from_them(rig: Rig, grasped: Grasped) -> None:
    for _, _, grasps in grasped:
        for grasp in grasps:
            assert ((grasp.joint_angles >= rig.hand.lower) & (grasp.joint_angles <= rig.hand.upper)).all()
            np.testing.assert_array_equal(grasp.sensor_pose, sensor_poses(rig.hand, grasp.hand_pose, grasp.joint_angles))


def test_no_rigid_part_is_in_the_object(rig: Rig, grasped: Grasped) -> None:
    """Random points on link boxes in the object, and on the object in link boxes; none deeper than 1 mm, and none than recorded."""
    rng = np.random.default_rng(1)
    for mesh, _, grasps in grasped:
        body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        on_object = trimesh.sample.sample_surface(body, 100_000, seed=2)[0]
        for grasp in grasps:
            frames = forward(rig.hand, grasp.hand_pose, grasp.joint_angles)
            for link, frame in zip(rig.hand.links, frames, strict=True):
                for shape in link.collisions:
                    pose = frame @ shape.origin
                    depth = (np.array(shape.size) / 2 - np.abs((on_object - pose[:3, 3]) @ pose[:3, :3])).min(axis=1).max()
                    assert depth <= max(1e-3, grasp.penetration + 3e-4)
                    unit = rng.uniform(-0.5, 0.5, (300, 3))
                    points = (unit * shape.size) @ pose[:3, :3].T + pose[:3, 3]
                    near = points[(np.abs(points - body.bounds.mean(axis=0)) < np.ptp(body.bounds, axis=0) / 2).all(axis=1)]
                    if len(near):
                        assert trimesh.proximity.signed_distance(body, near).max() <= max(1e-3, grasp.penetration + 3e-4)


def test_links_stay_out_of_each_other(rig: Rig, grasped: Grasped) -> None:
    """Points all through every link box, looked for in the boxes of links that are not its neighbours."""
    joined = {frozenset((joint.parent, joint.child)) for joint in rig.hand.joints}
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    for _, _, grasps in grasped:
        for grasp in grasps:
            frames = forward(rig.hand, grasp.hand_pose, grasp.joint_angles)[rig.boxes.link] @ rig.boxes.frames
            for a, (frame, half) in enumerate(zip(frames, rig.boxes.half, strict=True)):
                points = (grid * half) @ frame[:3, :3].T + frame[:3, 3]
                for b, (other, extent) in enumerate(zip(frames, rig.boxes.half, strict=True)):
                    pair = frozenset((int(rig.boxes.link[a]), int(rig.boxes.link[b])))
                    if len(pair) == 2 and pair not in joined:
                        assert (extent - np.abs((points - other[:3, 3]) @ other[:3, :3])).min(axis=1).max() <= 0


def test_a_settled_grasp_stays(rig: Rig) -> None:
    with simulation(rig.hand) as physics:
        physics.load(mug())
        scene = make_scene(mug(), *points_on(mug(), 2000, seed=1), SETTINGS.grid_cell)
        for number in range(3):
            grasp = attempt(rig, scene, physics, SETTINGS, numpy_rng(0, "grasped", number))
            assert grasp is not None
            later, _ = physics.advance((500, 500), 0.0)
            if grasp.sound:
                np.testing.assert_allclose(later, grasp.joint_angles, atol=5e-3)


def _joints(number: int) -> bytes:
    rig = make_rig(SETTINGS)
    with simulation(rig.hand) as physics:
        physics.load(bar())
        scene = make_scene(bar(), *points_on(bar(), 2000, seed=1), SETTINGS.grid_cell)
        grasp = attempt(rig, scene, physics, SETTINGS, numpy_rng(0, "grasped", number))
        assert grasp is not None
        return grasp.hand_pose.tobytes() + grasp.joint_angles.tobytes() + np.float64(grasp.penetration).tobytes()


def test_an_attempt_is_the_same_in_another_process_and_another_order(rig: Rig, try_at: TryAt) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        elsewhere = pool.map(_joints, [2])[0]
    with simulation(rig.hand) as physics:
        for mesh, number in ((mug(), 1), (bar(), 3), (bar(), 2)):
            physics.load(mesh)
            grasp = try_at(physics, mesh, number)
    assert grasp is not None
    assert grasp.hand_pose.tobytes() + grasp.joint_angles.tobytes() + np.float64(grasp.penetration).tobytes() == elsewhere


def test_the_best_are_kept_in_order_of_coming() -> None:
    def made(name: int, touches: int, sound: bool = True) -> Grasp:
        touched = np.arange(4) < touches
        return Grasp(np.eye(4), np.full(16, float(name)), np.zeros((4, 4, 4)), touched, 0.0, sound)

    kept: list[Grasp] = []
    for grasp in (made(0, 2), made(1, 4, sound=False), made(2, 3), None, made(3, 2), made(4, 3), made(5, 0)):
        kept = keep_best(kept, grasp, 3)
    assert [grasp.joint_angles[0] for grasp in kept] == [2, 4, 0]


def task_of(mesh: Mesh, points: np.ndarray, normals: np.ndarray) -> Task:
    surfaces = {"points": points.astype(np.float32), "normals": normals.astype(np.float32)}
    return Task("thing", "things", seed=0, inputs={"surfaces": surfaces}, load_mesh=lambda: mesh)


def test_a_row_is_what_the_schema_says() -> None:
    settings = SETTINGS.model_copy(update={"attempts": 6, "grasps": 2})
    with SimulateGrasps().session(settings, {}) as process:
        row = process(task_of(bar(), *points_on(bar(), 1000, seed=3)))
        early = SETTINGS.model_copy(update={"attempts": 6, "grasps": 2, "exhaustive": False})
    sizes = {"grasp": 2, "sensor": 4, "joint": 16, "pose_row": 4, "pose_column": 4}
    declared = {name: array for name, array in GRASPS.arrays.items() if name not in COMMON}
    assert set(row) == set(declared)
    for name, array in declared.items():
        assert row[name].dtype == np.dtype(array.dtype), name
        assert row[name].shape == tuple(sizes[dim] for dim in array.dims[1:]), name
    assert row["attempts"] == 6
    with SimulateGrasps().session(early, {}) as process:
        sooner = process(task_of(bar(), *points_on(bar(), 1000, seed=3)))
    assert sooner["attempts"] <= 6
    for name in ("hand_pose", "joint_angles", "sensor_pose", "touch_success", "penetration"):
        np.testing.assert_array_equal(sooner[name], row[name])


@pytest.mark.slow
@pytest.mark.parametrize("category", CATEGORIES)
def test_most_kept_touches_succeed_at_standard_settings(category: str) -> None:
    mesh = normalise_mesh(generate(category, numpy_rng(5, category)), "z", 0.5)
    points, normals = sample_exterior(mesh, 10_000, numpy_rng(6, category))
    with SimulateGrasps().session(GraspSettings(), {}) as process:
        row = process(task_of(mesh, points, normals))
    assert row["attempts"] == 50
    assert row["touch_success"].mean() >= 0.85
    assert row["touch_success"][:, 3].mean() >= 0.6
    assert row["attempt_success"].mean() >= 0.5
    assert row["penetration"].max() <= 1e-3


def test_an_object_without_room_for_a_hand_is_told_so() -> None:
    """A hollow ball 10 cm wide with points on its inner side only: the palm fits nowhere."""
    shell = placed(trimesh.creation.icosphere(subdivisions=2, radius=0.05))
    points, normals = points_on(shell, 100, seed=0)
    settings = SETTINGS.model_copy(update={"attempts": 1})
    told = pytest.raises(InvalidInput, match=r"0 of 5 grasps found in 1 attempts: the hand has no room")
    with SimulateGrasps().session(settings, {}) as process, told:
        process(task_of(shell, points, -normals))
