"""Collisions of fingers with each other and with the palm."""

from __future__ import annotations

import numpy as np

from pipeline.kernels.hand.collision_shapes import CollisionBoxes, collision_boxes
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import choose_postures, fingers_clear_of_palm, hand_gap

SPREAD = np.zeros(16)
SPREAD[12] = 0.9
CROSSED = SPREAD.copy()
CROSSED[[0, 1, 4, 5]] = [-0.47, 0.8, 0.47, 0.8]


def test_hand_gap_is_positive_for_spread_and_negative_for_crossed_fingers(hand: Hand) -> None:
    boxes = collision_boxes(hand)
    assert hand_gap(hand, boxes, forward_kinematics(hand, np.eye(4), SPREAD)) > 0.002
    assert hand_gap(hand, boxes, forward_kinematics(hand, np.eye(4), CROSSED)) < -0.005


def test_fingers_clear_of_palm_ignores_other_fingers(hand: Hand) -> None:
    frames = forward_kinematics(hand, np.eye(4), np.stack([SPREAD, CROSSED]))
    assert fingers_clear_of_palm(hand, collision_boxes(hand), frames, 0.001).all()


def test_choose_postures_drops_the_lesser_of_two_that_collide(hand: Hand) -> None:
    """The best index and the best middle finger cross, so the lesser of the two gives way."""
    boxes = collision_boxes(hand)
    options = np.zeros((2, 16))
    options[:, 12] = 0.9
    options[:, 1] = options[0, 5] = 0.8  # the other middle finger is straight
    options[0, [0, 4]] = [-0.47, 0.47]
    frames = forward_kinematics(hand, np.eye(4), options)
    worth = np.array([[3.0, 2.0, 1.0, 1.0], [1.0, 1.9, 1.0, 1.0]])
    picks = choose_postures(hand, boxes, frames=frames, worth=worth, gap=0.001)
    assert picks is not None
    assert picks[:2].tolist() == [0, 1]
    worth[1] = -np.inf
    assert choose_postures(hand, boxes, frames=frames, worth=worth, gap=0.001) is None


def test_choose_postures_without_options_or_boxes(hand: Hand) -> None:
    boxes = collision_boxes(hand)
    frames = forward_kinematics(hand, np.eye(4), np.clip(np.zeros((2, 16)), hand.lower, hand.upper))
    assert choose_postures(hand, boxes, frames=frames, worth=np.full((2, 4), -np.inf), gap=0.0) is None
    assert choose_postures(hand, boxes, frames=frames[:0], worth=np.zeros((0, 4)), gap=0.0) is None
    nothing = CollisionBoxes(np.zeros((0, 4, 4)), np.zeros((0, 3)), np.zeros(0, np.intp))
    picks = choose_postures(hand, nothing, frames=frames, worth=np.array([[0.0, 1, 0, 1], [1, 0, 1, 0]]), gap=0.0)
    assert picks is not None
    assert picks.tolist() == [1, 0, 1, 0]
