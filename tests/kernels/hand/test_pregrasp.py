"""Palm poses over a point, and fingers opened along their sensors' normals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.formats.hand_file import load_hand
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


@given(seed=seeds, distance=st.floats(-3, 3))
def test_pregrasp_stays_within_joint_limits(seed, distance) -> None:
    angles = np.random.default_rng(seed).uniform(HAND.lower, HAND.upper)
    still, opened = pregrasp_angles(HAND, angles, [0.0, distance])
    assert ((opened >= HAND.lower) & (opened <= HAND.upper)).all()
    np.testing.assert_array_equal(still, angles)


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
