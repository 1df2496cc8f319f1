"""Pre-grasp postures: sensors drawn back along their normals."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from tests.strategies import seeds

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
