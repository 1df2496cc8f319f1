"""Animated lifts: held objects stay, others fall; lifts are reproducible, and the animation agrees with them."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from pipeline.contrib.report.lift import CLOSING_FRAMES, CLOSING_SECONDS, FALL, Lift, lifts
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.drawing.gltf_animation import LENGTH_STEP
from pipeline.drawing.grasp_scene import GraspScenes
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.grasp_closure import measure_contact
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.physics.pybullet_engine import PybulletHoldTest
from pipeline.reconstruct.mesh_files import Y_UP
from tests.kernels.hand.meshes import centred, points_on
from tests.physics.pincers import SENSOR

GRIPPER, WIDTH, PRESSED = load_hand("two_finger_gripper"), 0.03, 0.002
SENSORS = [SENSOR, SENSOR]
Rows = Mapping[str, Mapping[str, Any]]


@pytest.fixture(scope="module")
def rows() -> Rows:
    """Make a post, gripped at its middle; and a grasp a metre aside, where nothing touches it."""
    mesh = centred(trimesh.creation.box((WIDTH, WIDTH, 0.2)))
    grip = WIDTH / 2 + SENSOR.w - PRESSED
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # the palm faces +x, the fingers slide along y
    pose[:3, 3] = [-0.082, 0.0, 0.6]
    aside = pose.copy()
    aside[1, 3] = 1.0
    poses, angles = np.stack([pose, aside]), np.full((2, 1), grip)
    sensor_pose = np.stack([sensor_poses(GRIPPER, own, one) for own, one in zip(poses, angles, strict=True)])
    faces = box_faces(mesh.triangles)
    touched = np.array([[measure_contact(faces, one, SENSOR) is not None for one in own] for own in sensor_pose])
    assert touched.tolist() == [[True, True], [False, False]]
    points, normals = points_on(mesh, 2000, seed=0)
    grasps = {"hand_pose": poses, "joint_angles": angles, "pregrasp_angles": angles + 0.01, "squeeze_angles": angles - 0.001}
    grasps |= {"sensor_pose": sensor_pose, "touch_success": touched, "contact_area": np.zeros((2, 2))}
    grasps |= {name: np.zeros((2, 2, 3)) for name in ("contact_point", "contact_normal")}
    return {"surfaces": {"points": points.astype(np.float32), "normals": normals, **mesh_row(mesh)}, "grasps": grasps}


@pytest.fixture(scope="module")
def engine() -> Iterator[PybulletHoldTest]:
    with PybulletHoldTest(GRIPPER, SENSORS, mass=0.2) as opened:
        yield opened


@pytest.fixture(scope="module")
def played(engine: PybulletHoldTest, rows: Rows) -> list[Lift]:
    return lifts(engine, rows["surfaces"], rows["grasps"], SENSORS)


def test_gripped_object_is_held_and_untouched_object_falls(played: list[Lift]) -> None:
    gripped, untouched = played
    assert gripped.held
    assert gripped.note.startswith("It stays: it moves ")
    assert not untouched.held
    assert untouched.note.startswith("It slips: it moves ")
    fallen = -untouched.object_motion[:, 2, 3]
    assert fallen[-2] < FALL < fallen[-1]
    times = np.maximum(untouched.times - CLOSING_SECONDS, 0)
    np.testing.assert_allclose(fallen, 9.81 * times**2 / 2, atol=0.01)


def test_fingers_close_on_an_object_that_is_still_then_let_go_of(played: list[Lift], rows: Rows) -> None:
    for number, lift in enumerate(played):
        grip = rows["grasps"]["joint_angles"][number]
        assert (np.diff(lift.times) > 0).all()
        assert lift.times[CLOSING_FRAMES - 1] == pytest.approx(CLOSING_SECONDS)
        np.testing.assert_array_equal(lift.joint_angles[0], rows["grasps"]["pregrasp_angles"][number])
        np.testing.assert_allclose(lift.joint_angles[CLOSING_FRAMES - 1], grip, atol=1e-9)
        np.testing.assert_array_equal(lift.object_motion[:CLOSING_FRAMES], np.tile(np.eye(4), (CLOSING_FRAMES, 1, 1)))
    assert played[0].joint_angles[-1] < rows["grasps"]["joint_angles"][0]  # motors drive to the squeeze


def test_lift_does_not_depend_on_earlier_lifts(engine: PybulletHoldTest, rows: Rows, played: list[Lift]) -> None:
    turned = {name: array[::-1] for name, array in rows["grasps"].items()}
    for one, again in zip(played, lifts(engine, rows["surfaces"], turned, SENSORS)[::-1], strict=True):
        np.testing.assert_array_equal(again.object_motion, one.object_motion)
        np.testing.assert_array_equal(again.joint_angles, one.joint_angles)


def test_grasps_without_a_squeeze_have_no_lift(engine: PybulletHoldTest, rows: Rows) -> None:
    older = {name: array for name, array in rows["grasps"].items() if name != "squeeze_angles"}
    assert lifts(engine, rows["surfaces"], older, SENSORS) == []


def read_glb(written: bytes) -> tuple[dict[str, Any], bytes]:
    length = struct.unpack("<I", written[12:16])[0]
    return json.loads(written[20 : 20 + length]), written[28 + length :]


def tracks(written: bytes, clip: str) -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
    """Read times (T,) and values (T, K) of every channel, by node and path; a reader of its own."""
    tree, content = read_glb(written)

    def accessor(number: int) -> np.ndarray:
        entry = tree["accessors"][number]
        assert entry["componentType"] == 5126
        view, width = tree["bufferViews"][entry["bufferView"]], {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[entry["type"]]
        values = np.frombuffer(content, "<f4", entry["count"] * width, view.get("byteOffset", 0)).reshape(-1, width)
        np.testing.assert_array_equal(entry["min"], values.min(axis=0))
        return values

    (animation,) = (one for one in tree["animations"] if one["name"] == clip)
    found = {}
    for channel in animation["channels"]:
        sampler, node = animation["samplers"][channel["sampler"]], tree["nodes"][channel["target"]["node"]]
        assert "matrix" not in node
        found[node["name"], channel["target"]["path"]] = accessor(sampler["input"])[:, 0], accessor(sampler["output"])
    return found


def test_animation_moves_hand_gels_and_object_as_the_lift_does(played: list[Lift], rows: Rows) -> None:
    scenes = GraspScenes(GRIPPER, SENSORS, small=True)
    scene = scenes.scene(rows)
    written = scenes.glb(scene, [scenes.clip(rows, number, lift) for number, lift in enumerate(played)])
    for grasp, lift in enumerate(played):
        found = tracks(written, f"grasp-{grasp}")
        frames = forward_kinematics(GRIPPER, rows["grasps"]["hand_pose"][grasp], lift.joint_angles)
        expected = {"object": Y_UP @ lift.object_motion}
        for number, (link, _) in enumerate(GRIPPER.visual_meshes):
            expected[f"grasp-{grasp}-hand-shape-{number}"] = frames[:, link]
        moving = {node for node, _ in found}
        assert {name for name, poses in expected.items() if np.ptp(poses, axis=0).max() > 1e-6} <= moving
        assert all(name == "object" or name.startswith(f"grasp-{grasp}-") for name in moving)
        for name in expected.keys() & moving:
            times, positions = found[name, "translation"]
            np.testing.assert_allclose(times, lift.times, atol=1e-6)
            np.testing.assert_allclose(positions, expected[name][:, :3, 3], atol=LENGTH_STEP)
            turns = Rotation.from_quat(found[name, "rotation"][1]).as_matrix()
            np.testing.assert_allclose(turns, expected[name][:, :3, :3], atol=5e-4)
        still = 1 + int(np.argmin(np.abs(lift.times[:CLOSING_FRAMES] - CLOSING_SECONDS)))
        gel = found[f"grasp-{grasp}-sensors-gel-{grasp}-0", "translation"][1]
        np.testing.assert_allclose(gel[still - 1], 0, atol=LENGTH_STEP)  # in the grasp gels are where they are stored
        np.testing.assert_allclose(np.abs(gel[0]).max(), 0.01, atol=1e-4)
    assert read_glb(scenes.glb(scene))[0].get("animations") is None
