"""Opposed points of a box and a ball, where they are known, and postures in which two gels face each other."""

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.distance_field import build_distance_field
from pipeline.kernels.hand.grasp_ik import GraspIk, prepare_grasp_ik
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.hand.pinches import antipodal_points, central_weights, opposed_postures
from pipeline.kernels.hand.self_collision import fingers_apart
from tests.kernels.hand.meshes import centred, points_on

CENTRE = np.array([0, 0, 0.6])


def test_opposed_points_of_a_box_lie_on_opposite_faces() -> None:
    sides = np.array([0.02, 0.06, 0.2])
    box = centred(trimesh.creation.box(sides))
    field = build_distance_field(box.vertices, box.faces, cell=0.005, band=0.03)
    pairs = antipodal_points(field, *points_on(box, 1000, seed=0), friction=0.5, widest=0.1, rng=np.random.default_rng(0))
    assert len(pairs.width) > 500
    ends = [np.abs(pairs.centre + side * pairs.width[:, None] / 2 * pairs.axis - CENTRE) for side in (-1, 1)]
    faces = [(np.abs(end - sides / 2) < 1e-6).argmax(axis=1) for end in ends]
    np.testing.assert_array_equal(*faces)
    assert set(faces[0]) == {0, 1}  # not across the length, which is wider than asked for
    along = np.abs(pairs.axis[np.arange(len(pairs.width)), faces[0]])
    assert (along >= np.cos(0.8 * np.arctan(0.5)) - 1e-9).all()
    np.testing.assert_allclose(pairs.width * along, sides[faces[0]], rtol=1e-5)


def test_opposed_points_of_a_ball_lie_across_its_centre_with_most_weight_on_the_nearest() -> None:
    ball = centred(trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    field = build_distance_field(ball.vertices, ball.faces, cell=0.005, band=0.03)
    pairs = antipodal_points(field, *points_on(ball, 1000, seed=0), friction=0.5, widest=0.1, rng=np.random.default_rng(0))
    off = np.linalg.norm(pairs.centre - CENTRE, axis=1)
    assert off.max() < 0.03 * np.sin(0.8 * np.arctan(0.5)) + 1e-3
    beside = CENTRE + [0.1, 0, 0]
    weights = central_weights(pairs, beside, spread=0.05)
    nearest = np.argsort(np.linalg.norm(pairs.centre - beside, axis=1))
    assert abs(weights.sum() - 1) < 1e-12
    assert (np.diff(weights[nearest]) <= 0).all()
    assert len(antipodal_points(field, *points_on(ball, 50, seed=0), friction=0.5, widest=0.01, rng=np.random.default_rng(0)).width) == 0


def ik_of(name: str) -> GraspIk:
    hand = load_hand(name)
    spheres = collision_spheres(hand, spacing=0.006, tolerance=0.002)
    sensors = [load_sensor(mount.sensor) for mount in hand.sensors]
    return prepare_grasp_ik(hand, spheres, sensors, samples=512, clearance=0.001, finger_gap=0.001)


@pytest.mark.parametrize(("name", "widest"), [("allegro_right", 0.15), ("two_finger_gripper", 0.05)])
def test_gels_face_each_other_across_the_width(name: str, widest: float) -> None:
    ik = ik_of(name)
    found = opposed_postures(ik)
    hand, rows = ik.hand, np.arange(len(found.width))
    poses = sensor_poses(hand, np.eye(4), found.joint_angles)
    first, second = (poses[rows, found.sensors[:, side]] for side in (0, 1))
    facing = -(first[:, :3, 2] * second[:, :3, 2]).sum(axis=1)
    assert np.rad2deg(np.arccos(facing.min())) < 30 + 1e-6
    np.testing.assert_allclose((first[:, :3, 3] + second[:, :3, 3]) / 2, found.centre, atol=0.01)  # gels are a few millimetres thick
    assert (np.diff(found.width) >= 0).all()
    assert found.width[0] < 0.02
    assert found.width[-1] > widest
    assert ((found.joint_angles >= hand.lower) & (found.joint_angles <= hand.upper)).all()
    for pair in np.unique(found.sensors, axis=0):
        own = (found.sensors == pair).all(axis=1)
        fingers = [int(hand.link_fingers[hand.sensors[sensor].link]) for sensor in pair]
        frames = forward_kinematics(hand, np.eye(4), found.joint_angles[own])
        assert fingers_apart(hand, ik.boxes, frames, fingers, 0.001).all()
