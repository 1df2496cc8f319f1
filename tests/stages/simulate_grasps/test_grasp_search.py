"""Attempts at grasps: sound by independent checks, and reproducible."""

import multiprocessing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.gel_balance import gel_load
from pipeline.kernels.hand.grasp import Contact, Grasp
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.physics.simulation import Simulation
from stages.simulate_grasps.grasp_search import GraspSearch
from stages.simulate_grasps.measured_grasps import Attempt
from stages.simulate_grasps.plans import TouchPlanner
from stages.simulate_grasps.prepare import PreparedHand, prepare_hand
from tests.kernels.hand.meshes import bar, mug
from tests.stages.simulate_grasps.conftest import SETTINGS, Grasped, attempt


def test_attempts_yield_sound_grasps_that_touch(grasped: Grasped) -> None:
    for _, grasps in grasped:
        assert len(grasps) >= 3
        assert max(grasp.touched.sum() for grasp, _ in grasps) >= 3


def test_touched_sensors_have_a_surface_in_the_gel(prepared: PreparedHand, grasped: Grasped) -> None:
    """Rays of trimesh's own from a few pixels of every sensor, over float32 Embree: a touch is something within the gel."""
    spots = (np.arange(24) + 0.5) / 24 * prepared.sensors[0].width - prepared.sensors[0].width / 2
    x, y = (axis.ravel() for axis in np.meshgrid(spots, spots))
    for mesh, grasps in grasped:
        body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        for grasp, _ in grasps:
            for pose, touched in zip(grasp.sensor_pose, grasp.touched, strict=True):
                origins = np.stack([x, y, np.zeros_like(x)], axis=1) @ pose[:3, :3].T + pose[:3, 3]
                hits, rays, _ = body.ray.intersects_location(origins, np.tile(pose[:3, 2], (len(x), 1)), multiple_hits=False)
                nearest = np.linalg.norm(hits - origins[rays], axis=1).min(initial=np.inf)
                if touched:
                    assert 0 < nearest < prepared.sensors[0].w + 5e-4  # 24² rays pass by what 100² see
                else:
                    assert nearest > prepared.sensors[0].w - 2e-4


def test_grasp_keeps_joint_limits_and_sensor_poses_follow_from_joints(prepared: PreparedHand, grasped: Grasped) -> None:
    for _, grasps in grasped:
        for grasp, _ in grasps:
            assert ((grasp.joint_angles >= prepared.hand.lower) & (grasp.joint_angles <= prepared.hand.upper)).all()
            np.testing.assert_array_equal(grasp.sensor_pose, sensor_poses(prepared.hand, grasp.hand_pose, grasp.joint_angles))


def test_sound_grasp_penetrates_no_deeper_than_recorded(prepared: PreparedHand, grasped: Grasped) -> None:
    """Random points on link boxes in the object, and on the object in link boxes; none deeper than 1 mm, and none than recorded."""
    rng = np.random.default_rng(1)
    for mesh, grasps in grasped:
        body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        on_object = trimesh.sample.sample_surface(body, 100_000, seed=2)[0]
        for grasp, penetration in grasps:
            frames = forward_kinematics(prepared.hand, grasp.hand_pose, grasp.joint_angles)
            for link, frame in zip(prepared.hand.links, frames, strict=True):
                for shape in link.collisions:
                    pose = frame @ shape.origin
                    depth = (np.array(shape.size) / 2 - np.abs((on_object - pose[:3, 3]) @ pose[:3, :3])).min(axis=1).max()
                    assert depth <= max(1e-3, penetration + 3e-4)
                    unit = rng.uniform(-0.5, 0.5, (300, 3))
                    points = (unit * shape.size) @ pose[:3, :3].T + pose[:3, 3]
                    near = points[(np.abs(points - body.bounds.mean(axis=0)) < np.ptp(body.bounds, axis=0) / 2).all(axis=1)]
                    if len(near):
                        assert trimesh.proximity.signed_distance(body, near).max() <= max(1e-3, penetration + 3e-4)


def test_sound_grasp_has_no_links_inside_each_other(prepared: PreparedHand, grasped: Grasped) -> None:
    """Points all through every link box, looked for in the boxes of links that are not its neighbours."""
    joined = {frozenset((joint.parent, joint.child)) for joint in prepared.hand.joints}
    boxes = prepared.ik.boxes
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    for _, grasps in grasped:
        for grasp, _ in grasps:
            frames = forward_kinematics(prepared.hand, grasp.hand_pose, grasp.joint_angles)[boxes.link] @ boxes.frames
            for a, (frame, half) in enumerate(zip(frames, boxes.half, strict=True)):
                points = (grid * half) @ frame[:3, :3].T + frame[:3, 3]
                for b, (other, extent) in enumerate(zip(frames, boxes.half, strict=True)):
                    pair = frozenset((int(boxes.link[a]), int(boxes.link[b])))
                    if len(pair) == 2 and pair not in joined:
                        assert (extent - np.abs((points - other[:3, 3]) @ other[:3, :3])).min(axis=1).max() <= 0


def test_sound_grasp_is_at_rest(prepared: PreparedHand) -> None:
    with Simulation(prepared.hand) as physics:
        physics.load(mug())
        attempts = []
        for number in range(3):
            attempts.append(item := attempt(prepared, physics, mug(), number))
            assert item is not None
            for _ in range(500):
                physics.client.stepSimulation()
            later, _ = physics._body.joint_states()
            if item.fault is None:
                np.testing.assert_allclose(later, item.grasp.joint_angles, atol=5e-3)
        assert any(item.fault is None for item in attempts)


def _attempted(numbers: list[int]) -> bytes:
    """Attempt grasps of a bar, one after the other; the bytes of the last."""
    prepared = prepare_hand(SETTINGS)
    with Simulation(prepared.hand) as physics:
        for number in numbers:
            physics.load(bar())
            item = attempt(prepared, physics, bar(), number)
    assert item is not None
    return item.grasp.hand_pose.tobytes() + item.grasp.joint_angles.tobytes() + np.float64(item.penetration).tobytes()


def test_attempt_does_not_depend_on_process_or_order() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(_attempted, [[2]])[0] == _attempted([1, 3, 2])


def made(*areas: float, holds: bool = False) -> Attempt:
    contacts = [Contact(np.zeros(3), np.array([0.0, 0, 1]), area) if area else None for area in areas]
    angles = np.zeros(16)
    return Attempt(Grasp(np.eye(4), angles, angles, angles, np.zeros((4, 4, 4)), contacts), 0.0, None, holds)


def test_best_grasps_hold_then_have_most_touches_area_or_closure_then_are_earlier(monkeypatch: pytest.MonkeyPatch) -> None:
    few, large, opposed, many, equal = made(1, 0, 0, 0), made(9, 0, 0, 0), made(1, 1, 0, 0), made(1, 1, 1, 1), made(1, 1, 1, 1)
    held = made(0, 0, 0, 0, holds=True)
    monkeypatch.setattr(GraspSearch, "closure", lambda self, grasp: 0.4 * (grasp is opposed.grasp))
    for prefer, best in (("touches", [many, equal, opposed]), ("area", [large, many, equal]), ("closure", [opposed, many, equal])):
        unused: Any = None
        search = GraspSearch(TouchPlanner(unused, unused, SETTINGS.model_copy(update={"prefer": prefer, "grasps": 3})), unused)
        kept: list[Attempt] = []
        for item in (few, large, opposed, many, equal):
            kept = search.keep_best(kept, item)
        assert list(map(id, kept)) == list(map(id, best)), prefer
        assert search.keep_best(kept, held)[0] is held


def test_fingers_close_on_elastic_gels_up_to_the_motors_torque_and_on_others_as_planned(prepared: PreparedHand) -> None:
    hand, mini, mesh, nudge = prepared.hand, load_sensor("gelsight_mini"), mug(), 1e-5
    worn = replace(prepared, sensors=(mini,) * 4)
    faces, torques = box_faces(mesh.triangles), []
    with Simulation(hand) as physics:
        physics.load(mesh)
        for number in range(2):
            soft, made = attempt(prepared, physics, mesh, number), attempt(worn, physics, mesh, number)
            if not (soft and made):
                continue
            assert not np.array_equal(soft.grasp.joint_angles, made.grasp.joint_angles)
            nudged = sensor_poses(hand, made.grasp.hand_pose, made.grasp.joint_angles + nudge * np.eye(16))
            for s, (pose, touched) in enumerate(zip(made.grasp.sensor_pose, made.grasp.touched, strict=True)):
                if touched:
                    pressed = impression(ray_depth(faces, pose, mini), mini)
                    force, centre = gel_load(pressed, mini)
                    arms = ((nudged[:, s] - pose) @ np.append(centre, 1))[:, :3] @ pose[:3, 2] / nudge
                    torques.append(force * np.abs(arms).max())
                    assert pressed.max() < 0.91 * mini.layer_thickness
    assert max(torques) == pytest.approx(hand.torque, rel=0.06)
