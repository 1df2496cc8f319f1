"""Gaps between boxes, and collisions of fingers with each other and with the palm."""

import dataclasses
import sys

import numba
import numpy as np
import pytest

from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import box_gap, choose_postures, close_links, finger_conflicts, hand_gap
from tests.kernels.hand.meshes import random_pose
from tests.strategies import EPS

EVEN_SAMPLES = np.zeros(16)
EVEN_SAMPLES[12] = 0.9
CROSSED = EVEN_SAMPLES.copy()
CROSSED[[0, 1, 4, 5]] = [-0.47, 0.8, 0.47, 0.8]


def test_hand_gap_is_positive_for_spread_and_negative_for_crossed_fingers(hand: Hand) -> None:
    boxes = collision_boxes(hand)
    assert hand_gap(hand, boxes, forward_kinematics(hand, np.eye(4), EVEN_SAMPLES)) > 0.002
    assert hand_gap(hand, boxes, forward_kinematics(hand, np.eye(4), CROSSED)) < -0.005


def test_choose_postures_drops_the_lower_rated_of_two_that_collide(hand: Hand) -> None:
    """The best index and the best middle finger cross, so the lower-rated of the two is dropped."""
    boxes = collision_boxes(hand)
    options = np.zeros((2, 16))
    options[:, 12] = 0.9
    options[:, 1] = options[0, 5] = 0.8  # the other middle finger is straight
    options[0, [0, 4]] = [-0.47, 0.47]
    frames = forward_kinematics(hand, np.eye(4), options)
    values = np.array([[3.0, 2.0, 1.0, 1.0], [1.0, 1.9, 1.0, 1.0]])
    picks = choose_postures(hand, boxes, frames=frames, values=values, gap=0.001)
    assert picks[0, :2].tolist() == [0, 1]
    values[1] = -np.inf
    assert not len(choose_postures(hand, boxes, frames=frames, values=values, gap=0.001))


def test_fingers_may_touch_where_the_hand_file_allows_it(hand: Hand) -> None:
    boxes = collision_boxes(hand)
    frames = forward_kinematics(hand, np.eye(4), CROSSED)[None]
    assert finger_conflicts(hand, boxes, frames, 0.001)[0, 1, 0, 0]
    index, middle = (np.flatnonzero(hand.link_fingers == finger).tolist() for finger in (0, 1))
    allowed = frozenset((min(a, b), max(a, b)) for a in index for b in middle)
    assert not finger_conflicts(dataclasses.replace(hand, allowed_contacts=allowed), boxes, frames, 0.001).any()


def test_box_gap_of_boxes_side_by_side_is_their_distance_or_overlap() -> None:
    half, other = np.array([0.1, 0.2, 0.3]), np.eye(4)
    for shift, expected in ((0.25, 0.05), (0.2, 0), (0.15, -0.05), (0, -0.2)):
        other[0, 3] = shift
        assert box_gap(np.eye(4), half, other, half) == pytest.approx(expected, abs=4 * EPS)
    assert box_gap(np.eye(4), 0 * half, np.eye(4), 0 * half) == 0


def test_box_gap_is_positive_only_for_boxes_that_are_apart(rng: np.random.Generator) -> None:
    half = np.array([0.02, 0.03, 0.04])
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 15)] * 3), axis=-1).reshape(-1, 3) * half
    seen = []
    for _ in range(300):
        a, b = random_pose(rng), random_pose(rng)
        b[:3, 3] = a[:3, 3] + rng.normal(size=3) * 0.03
        gap = float(box_gap(a, half, b, half))
        local = ((grid @ b[:3, :3].T + b[:3, 3]) - a[:3, 3]) @ a[:3, :3]  # points of b in a's frame
        distance = np.linalg.norm(np.maximum(np.abs(local) - half, 0), axis=1).min()
        assert gap <= distance + 1e-12
        if distance == 0:
            assert gap <= 0
        seen.append((gap > 0, distance > 0.006))  # the grid is 6 mm wide
    separated, clear = np.array(seen).T
    assert separated[clear].all()
    assert 0.05 < separated.mean() < 0.9


def test_gaps_at_rest_are_the_same_in_a_process_without_numba(hand: Hand, monkeypatch) -> None:
    boxes = collision_boxes(hand)
    compiled = close_links(hand, boxes, 1.0)
    monkeypatch.delitem(sys.modules, numba.__name__)
    assert close_links(hand, boxes, 1.0) == compiled
    assert compiled
