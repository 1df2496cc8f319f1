"""Palm poses over a point, and fingers opened along their sensors' normals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand import pregrasp
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.pregrasp import pregrasp_angles, tangent_palm_pose
from tests.strategies import EPS, random_rotation, seeds

HAND = load_hand("allegro_right")


def test_pregrasp_moves_sensors_against_their_normals(hand: Hand, rng: np.random.Generator) -> None:
    angles = (hand.lower + hand.upper) / 2 + rng.uniform(-0.2, 0.2, 16)
    before, after = (sensor_poses(hand, np.eye(4), q) for q in (angles, pregrasp_angles(hand, angles, [0.002])[0]))
    moved = after[:, :3, 3] - before[:, :3, 3]
    np.testing.assert_allclose(moved, -0.002 * before[:, :3, 2], atol=3e-4)


@given(seed=seeds, distance=st.floats(-0.01, 0.01))
def test_sensor_never_gets_further_from_its_goal(seed, distance) -> None:
    angles = np.clip(np.random.default_rng(seed).uniform(HAND.lower - 0.3, HAND.upper + 0.3), HAND.lower, HAND.upper)
    before, after = (sensor_poses(HAND, np.eye(4), q) for q in (angles, pregrasp_angles(HAND, angles, [distance])[0]))
    missed = after[:, :3, 3] - before[:, :3, 3] + distance * before[:, :3, 2]
    assert np.linalg.norm(missed, axis=1).max() <= abs(distance) + 1e-6


@given(seed=seeds, joints=st.integers(1, 7), planar=st.booleans())
def test_step_is_the_best_within_its_bounds(seed, joints, planar) -> None:
    rng = np.random.default_rng(seed)
    jacobian, target = 0.06 * rng.normal(size=(3, joints)), 0.004 * rng.normal(size=3)
    if planar:  # a finger whose joints are parallel
        jacobian[2], jacobian[1] = 0, np.sort(np.abs(jacobian[1]))
    least, most = (sign * rng.exponential(0.03, joints) * (rng.random(joints) < 0.7) + sign * 1e-6 for sign in (-1, 1))
    step = pregrasp._bounded_step(jacobian, target, least, most)
    matrix, goal = np.vstack([jacobian, pregrasp.LIMIT_DAMPING * np.eye(joints)]), np.r_[target, np.zeros(joints)]
    best = lsq_linear(matrix, goal, (least, most), method="bvls", tol=1e-15).x
    if ((step == least) | (step == most)).any():
        cost, least_cost = (((matrix @ angles - goal) ** 2).sum() for angles in (step, best))
        assert cost <= least_cost * (1 + 1e-9) + 1e-15
    assert ((least <= step) & (step <= most)).all()


@given(seed=seeds, size=st.floats(1e-3, 1e3), distance=st.floats(-1, 1), angle=st.floats(-10, 10))
def test_palm_faces_the_point_at_the_set_distance_and_angle(seed, size, distance, angle) -> None:
    rng = np.random.default_rng(seed)
    point, normal = rng.normal(size=3), random_rotation(rng)[0]
    pose = tangent_palm_pose(HAND, point, normal * size, distance=distance, angle=angle)
    assert np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() <= 8 * EPS
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert np.abs(pose[:3, :3] @ HAND.palm_facing + normal).max() <= 8 * EPS
    palm = pose[:3, :3] @ HAND.palm_centre + pose[:3, 3]
    assert np.abs(palm - point - distance * normal).max() <= 8 * EPS * (np.abs(point).max() + 1)
    turned = tangent_palm_pose(HAND, point, normal * size, distance=distance, angle=angle + 0.3)[:3, :3] @ pose[:3, :3].T
    assert np.trace(turned) == pytest.approx(1 + 2 * np.cos(0.3))


@pytest.mark.parametrize(("point", "normal"), [([0, 0, 0], [0, 0, 0]), ([0, 0, 0], [np.nan, 0, 1]), ([np.inf, 0, 0], [0, 0, 1])])
def test_palm_pose_rejects_normal_without_direction(hand: Hand, point: list[float], normal: list[float]) -> None:
    with pytest.raises(ValueError, match="no hand can face"):
        tangent_palm_pose(hand, np.array(point, float), np.array(normal, float), distance=0.1, angle=0.0)
