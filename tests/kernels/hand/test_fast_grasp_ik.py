"""Lazy inverse kinematics against a twin that evaluates every posture completely: equal to the bit."""

import numpy as np
import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.distance_field import DistanceField, build_distance_field, finger_clearance
from pipeline.kernels.hand.grasp_ik import GraspIk, grasp_ik, prepare_grasp_ik
from pipeline.kernels.hand.pregrasp import tangent_palm_pose
from tests.kernels.hand.meshes import bar, mug, points_on
from tests.references.slow_grasp_ik import slow_clearance, slow_grasp_ik

OBJECTS = [mug(), bar()]


@pytest.fixture(scope="module", params=["allegro_right", "two_finger_gripper"])
def ik(request: pytest.FixtureRequest) -> GraspIk:
    hand = load_hand(request.param)
    sensors = [load_sensor(mount.sensor) for mount in hand.sensors]
    spheres = collision_spheres(hand, spacing=0.01, tolerance=0.002)
    return prepare_grasp_ik(hand, spheres, sensors, samples=512, clearance=0.001, finger_gap=0.001)


@pytest.fixture(scope="module", params=OBJECTS, ids=["mug", "bar"])
def field(request: pytest.FixtureRequest) -> DistanceField:
    return build_distance_field(request.param.vertices, request.param.faces, cell=0.005, band=0.03)


def poses_around(ik: GraspIk, mesh: Mesh, count: int) -> list[np.ndarray]:
    """Make palm poses over points of a mesh, at increasing distance."""
    places = zip(*points_on(mesh, count, seed=0), np.linspace(0.02, 0.08, count), strict=True)
    return [tangent_palm_pose(ik.hand, point, normal, distance=distance, angle=9 * distance) for point, normal, distance in places]


def test_postures_equal_the_slow_twin(ik: GraspIk, field: DistanceField) -> None:
    found = 0
    for pose in poses_around(ik, Mesh.bare(field.vertices, field.faces), 4):
        fast, slow = (search(ik, field, pose, rounds=1, rng=np.random.default_rng(0)) for search in (grasp_ik, slow_grasp_ik))
        assert (slow is None) == (not len(fast.picks))
        if slow is not None:
            np.testing.assert_array_equal(fast.joint_angles(0), slow)
            found += 1
    assert found > 0


def test_clearance_is_exact_down_to_the_floor(ik: GraspIk, field: DistanceField) -> None:
    frames = np.concatenate([pose @ ik.postures.frames[:20] for pose in poses_around(ik, Mesh.bare(field.vertices, field.faces), 3)])
    exact = slow_clearance(ik, field, frames)
    np.testing.assert_array_equal(finger_clearance(field, ik.fingers, frames), exact)
    floor = float(np.median(exact))
    cut = finger_clearance(field, ik.fingers, frames, floor=floor)
    assert ((cut == exact) | (exact <= cut) & (cut < floor)).all()
