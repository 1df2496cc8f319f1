"""What stands for the hand's rigid parts: balls and boxes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pipeline.kernels.hand.bodies import collision_balls, collision_boxes
from pipeline.kernels.hand.boxes import box_gap
from pipeline.kernels.hand.choice import choose_together, hand_gap
from pipeline.kernels.hand.distance import distance_field
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.placement import tangent_pose
from pipeline.kernels.hand.reach import ball_points
from tests.grasps.test_hand import pose_of


def test_balls_fill_their_links_and_no_more(hand: Hand) -> None:
    spacing = 0.004
    balls = collision_balls(hand, spacing)
    for number, link in enumerate(hand.links):
        own = balls.of([number])
        depth = np.max([box_depth(own.centres, shape.size, shape.origin) for shape in link.collisions], axis=0)
        assert (own.radii <= depth + 1e-9).all()
        assert (depth >= -1e-9).all()
        for shape in link.collisions:
            corners = trimesh.creation.box(shape.size).vertices + shape.origin[:3, 3]
            gaps = np.linalg.norm(corners[:, None] - own.centres, axis=-1) - own.radii
            assert gaps.min(axis=1).max() < 1e-6


def test_pruned_balls_still_reach_as_far(hand: Hand) -> None:
    tolerance = 0.002
    all_, few = collision_balls(hand, 0.006), collision_balls(hand, 0.006, tolerance)
    assert len(few.radii) < len(all_.radii) / 3
    for number in range(len(hand.links)):
        own, kept = all_.of([number]), few.of([number])
        gap = np.linalg.norm(own.centres[:, None] - kept.centres, axis=-1) + own.radii[:, None] - kept.radii
        assert gap.min(axis=1).max() <= tolerance + 1e-12


def test_balls_find_a_needle_in_a_link(hand: Hand) -> None:
    """Its surface has no point of the hand in it, but it stands 8 mm inside the hand."""
    needle = trimesh.creation.box((0.0002, 0.0002, 0.1)).apply_translation([0, 0, 0.05])
    field = distance_field(needle.vertices, needle.faces, 0.0025, 0.012)
    balls = collision_balls(hand, 0.003).of([hand.fingers[1].links[1]])
    box = next(shape for shape in hand.links[hand.fingers[1].links[1]].collisions)
    frames = np.tile(np.eye(4), (len(hand.links), 1, 1))
    frames[:, :3, 3] = [0, 0, -box.size[2] + 0.008]  # the link's far face is 8 mm above the needle's point
    depth = -(field.exact(ball_points(balls, frames[None])[:, 0].T) - balls.radii).min()
    assert depth == pytest.approx(0.008, abs=0.0015)


def box_depth(points: np.ndarray, size: tuple[float, ...], origin: np.ndarray) -> np.ndarray:
    return (np.array(size) / 2 - np.abs(points - origin[:3, 3])).min(axis=1)


def test_gap_of_boxes_against_closed_forms_and_samples(rng: np.random.Generator) -> None:
    half = np.array([0.02, 0.03, 0.04])
    apart = np.eye(4)
    apart[:3, 3] = [0.05, 0, 0]
    assert box_gap(np.eye(4), half, apart, half) == pytest.approx(0.01)
    apart[:3, 3] = [0.03, 0, 0]
    assert box_gap(np.eye(4), half, apart, half) == pytest.approx(-0.01)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 15)] * 3), axis=-1).reshape(-1, 3) * half
    seen = []
    for _ in range(300):
        a, b = pose_of(rng), pose_of(rng)
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


def test_a_spread_hand_is_free_and_a_crossed_one_is_not(hand: Hand) -> None:
    boxes = collision_boxes(hand)
    open_hand = np.zeros(16)
    open_hand[12] = 0.9
    assert hand_gap(hand, boxes, forward(hand, np.eye(4), open_hand)) > 0.002
    crossed = open_hand.copy()
    crossed[[0, 1, 4, 5]] = [-0.47, 0.8, 0.47, 0.8]
    assert hand_gap(hand, boxes, forward(hand, np.eye(4), crossed)) < -0.005


def test_fingers_are_chosen_together(hand: Hand) -> None:
    """The best index and the best middle finger cross, so the lesser of the two gives way."""
    boxes = collision_boxes(hand)
    options = np.zeros((2, 16))
    options[:, 12] = 0.9
    options[:, 1] = options[0, 5] = 0.8  # the other middle finger is straight
    options[0, [0, 4]] = [-0.47, 0.47]
    frames = forward(hand, np.eye(4), options)
    worth = np.array([[3.0, 2.0, 1.0, 1.0], [1.0, 1.9, 1.0, 1.0]])
    picks = choose_together(hand, boxes, frames, worth, 0.001)
    assert picks is not None
    assert picks[:2].tolist() == [0, 1]
    worth[1] = -np.inf
    assert choose_together(hand, boxes, frames, worth, 0.001) is None


def test_the_palm_faces_the_point_tangentially(hand: Hand, rng: np.random.Generator) -> None:
    for _ in range(10):
        point, normal = rng.normal(size=3), rng.normal(size=3)
        distance, angle = rng.uniform(0, 0.1), rng.uniform(0, 2 * np.pi)
        pose = tangent_pose(hand, point, normal, distance, angle)
        unit = normal / np.linalg.norm(normal)
        np.testing.assert_allclose(pose[:3, :3] @ hand.palm_facing, -unit, atol=1e-12)
        np.testing.assert_allclose((pose @ [*hand.palm_centre, 1])[:3], point + distance * unit, atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
        turned = tangent_pose(hand, point, normal, distance, angle + 0.3)[:3, :3] @ pose[:3, :3].T
        assert np.trace(turned) == pytest.approx(1 + 2 * np.cos(0.3))
