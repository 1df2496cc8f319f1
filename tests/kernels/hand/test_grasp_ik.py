"""Inverse kinematics on a plate, where the answer is known, and against a twin that evaluates every posture: equal to the bit."""

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.distance_field import DistanceField, build_distance_field, finger_clearance
from pipeline.kernels.hand.grasp_ik import GraspIk, fingers_fit, grasp_ik, prepare_grasp_ik
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.pregrasp import tangent_palm_pose
from tests.kernels.hand.meshes import bar, mug, points_on
from tests.references.slow_grasp_ik import slow_clearance, slow_grasp_ik

TOP = 0.61


@pytest.fixture(scope="module")
def plate() -> DistanceField:
    """2 cm thick; its upper side is at z = 0.61."""
    body = trimesh.creation.box((0.4, 0.4, 0.02)).apply_translation((0, 0, TOP - 0.01))
    return build_distance_field(body.vertices, body.faces, cell=0.0025, band=0.012)


@pytest.fixture(scope="module")
def ik(hand: Hand) -> GraspIk:
    spheres = collision_spheres(hand, spacing=0.006, tolerance=0.002)
    return prepare_grasp_ik(
        hand, spheres, [load_sensor(mount.sensor) for mount in hand.sensors], samples=512, clearance=0.001, finger_gap=0.001
    )


def above_plate(hand: Hand, height: float) -> np.ndarray:
    return tangent_palm_pose(hand, np.array([0, 0, TOP]), np.array([0, 0, 1.0]), distance=height, angle=0.0)


def test_grasp_ik_reaches_a_plate_and_stays_out_of_it(ik: GraspIk, plate: DistanceField, rng: np.random.Generator) -> None:
    hand, pose = ik.hand, above_plate(ik.hand, 0.05)
    angles = grasp_ik(ik, plate, pose, rounds=3, rng=rng).joint_angles(0)
    assert ((angles >= hand.lower) & (angles <= hand.upper)).all()
    assert (sensor_poses(hand, pose, angles)[:, 2, 2] < 0).sum() >= 3  # the gels face the plate
    frames = forward_kinematics(hand, pose, angles)
    spheres = collision_spheres(hand, spacing=0.003)
    corners = [frames[link] @ [*centre, 1] for centre, link in zip(spheres.centres, spheres.link, strict=True)]
    assert np.min(corners, axis=0)[2] > TOP - 1e-4  # every rigid point is above the plate: no measure of the search's own


def test_fingers_fit_above_the_plate_and_not_inside_it(ik: GraspIk, plate: DistanceField) -> None:
    assert fingers_fit(ik, plate, above_plate(ik.hand, 0.06))
    assert not fingers_fit(ik, plate, above_plate(ik.hand, -0.04))


def test_grasp_ik_finds_no_posture_where_the_hand_is_inside_the_object(ik: GraspIk, rng: np.random.Generator) -> None:
    block = trimesh.creation.box((1.0, 1.0, 1.0)).apply_translation((0, 0, TOP))
    field = build_distance_field(block.vertices, block.faces, cell=0.02, band=0.05)
    assert not len(grasp_ik(ik, field, above_plate(ik.hand, 0.0), rounds=1, rng=rng).picks)


OBJECTS = [mug(), bar()]


@pytest.fixture(scope="module", params=["allegro_right", "two_finger_gripper"])
def either(request: pytest.FixtureRequest) -> GraspIk:
    hand = load_hand(request.param)
    sensors = [load_sensor(mount.sensor) for mount in hand.sensors]
    spheres = collision_spheres(hand, spacing=0.01, tolerance=0.002)
    return prepare_grasp_ik(hand, spheres, sensors, samples=512, clearance=0.001, finger_gap=0.001)


@pytest.fixture(scope="module", params=OBJECTS, ids=["mug", "bar"])
def field(request: pytest.FixtureRequest) -> DistanceField:
    return build_distance_field(request.param.vertices, request.param.faces, cell=0.005, band=0.03)


def poses_around(either: GraspIk, mesh: Mesh, count: int) -> list[np.ndarray]:
    """Make palm poses over points of a mesh, at increasing distance."""
    places = zip(*points_on(mesh, count, seed=0), np.linspace(0.02, 0.08, count), strict=True)
    return [tangent_palm_pose(either.hand, point, normal, distance=distance, angle=9 * distance) for point, normal, distance in places]


def test_postures_equal_the_slow_twin(either: GraspIk, field: DistanceField) -> None:
    found = 0
    for pose in poses_around(either, Mesh.bare(field.vertices, field.faces), 4):
        fast, slow = (search(either, field, pose, rounds=1, rng=np.random.default_rng(0)) for search in (grasp_ik, slow_grasp_ik))
        assert (slow is None) == (not len(fast.picks))
        if slow is not None:
            np.testing.assert_array_equal(fast.joint_angles(0), slow)
            found += 1
    assert found > 0


def test_clearance_is_exact_down_to_the_floor(either: GraspIk, field: DistanceField) -> None:
    frames = np.concatenate(
        [pose @ either.postures.frames[:20] for pose in poses_around(either, Mesh.bare(field.vertices, field.faces), 3)]
    )
    exact = slow_clearance(either, field, frames)
    np.testing.assert_array_equal(finger_clearance(field, either.fingers, frames), exact)
    floor = float(np.median(exact))
    cut = finger_clearance(field, either.fingers, frames, floor=floor)
    assert ((cut == exact) | (exact <= cut) & (cut < floor)).all()
