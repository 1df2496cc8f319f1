"""Kinematics, placing, boxes and bodies at the ends of their ranges, and hand files with numbers that are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st

from pipeline.config.hand_file import load_hand
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.approach import draw_back
from pipeline.kernels.hand.bodies import Boxes, collision_balls, collision_boxes
from pipeline.kernels.hand.boxes import box_gap
from pipeline.kernels.hand.choice import choose_together
from pipeline.kernels.hand.clearance import deepest
from pipeline.kernels.hand.distance import distance_field
from pipeline.kernels.hand.kinematics import forward, sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.placement import tangent_pose
from pipeline.kernels.hand.reach import ball_points, finger_clearance, finger_parts, gel_contact, gel_probes
from tests.extremes.profile import for_all
from tests.extremes.strategies import EPS, offsets, scales, seeds, turn

HAND = load_hand("allegro_right")


def posture(rng: np.random.Generator, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn(rng), offset
    return pose, rng.uniform(HAND.lower, HAND.upper)


@for_all(few=20, many=1000, seed=seeds, offset=offsets, turns=st.integers(-1000, 1000))
def test_frames_stay_rigid_far_away_and_after_many_turns(seed, offset, turns) -> None:
    pose, angles = posture(np.random.default_rng(seed), offset)
    here = pose.copy()
    here[:3, 3] = 0
    near, far = forward(HAND, here, angles), forward(HAND, pose, angles + 2 * np.pi * turns)
    rotations = far[:, :3, :3]
    assert np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max() <= 1e-14
    assert (far[:, 3] == [0, 0, 0, 1]).all()
    rounding = 2 * np.pi * (abs(turns) + 1) * EPS * 8  # of the angles, each on an arm below 0.3 m, four in a row
    assert np.abs(far[:, :3, 3] - offset - near[:, :3, 3]).max() <= 1e-15 + rounding + 4 * EPS * np.abs(offset).max()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_postures_that_are_no_numbers_are_named(bad) -> None:
    angles = np.zeros(16)
    angles[3] = bad
    for ask in (lambda: forward(HAND, np.eye(4), angles), lambda: sensor_poses(HAND, np.eye(4) + bad, np.zeros(16))):
        with pytest.raises(ValueError, match="joint_angles or hand_pose of allegro_right hold NaN or infinity"):
            ask()


def test_no_postures_have_no_frames() -> None:
    assert forward(HAND, np.eye(4), np.zeros((0, 16))).shape == (0, len(HAND.links), 4, 4)


@for_all(few=10, many=300, seed=seeds, distance=st.floats(-3, 3))
def test_drawing_back_stays_within_limits_however_far(seed, distance) -> None:
    _, angles = posture(np.random.default_rng(seed), np.zeros(3))
    still, opened = draw_back(HAND, angles, [0.0, distance])
    assert ((opened >= HAND.lower) & (opened <= HAND.upper)).all()
    np.testing.assert_array_equal(still, angles)


@for_all(few=50, many=3000, seed=seeds, offset=offsets, length=st.floats(-300, 300), distance=st.floats(-1, 1), angle=st.floats(-1e3, 1e3))
def test_the_palm_faces_a_point_whatever_the_normals_length(seed, offset, length, distance, angle) -> None:
    normal = turn(np.random.default_rng(seed))[0]
    pose = tangent_pose(HAND, offset, normal * 10.0**length, distance, angle)
    assert np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() <= 8 * EPS
    assert np.abs(pose[:3, :3] @ HAND.palm_facing + normal).max() <= 8 * EPS
    palm = pose[:3, :3] @ HAND.palm_centre + pose[:3, 3]
    assert np.abs(palm - offset - distance * normal).max() <= 8 * EPS * (np.abs(offset).max() + 1)


@pytest.mark.parametrize(("point", "normal"), [([0, 0, 0], [0, 0, 0]), ([0, 0, 0], [np.nan, 0, 1]), ([np.inf, 0, 0], [0, 0, 1])])
def test_no_palm_faces_a_normal_without_direction(point, normal) -> None:
    with pytest.raises(ValueError, match="no hand can face"):
        tangent_pose(HAND, np.array(point, float), np.array(normal, float), 0.1, 0.0)


def two_boxes(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Poses (2, 4, 4) and half extents (2, 3); some are plates, rods or points."""
    frames = np.tile(np.eye(4), (2, 1, 1))
    frames[:, :3, :3] = [turn(rng), turn(rng)]
    frames[1, :3, 3] = rng.normal(size=3) * 2
    return frames, rng.uniform(0, 1, (2, 3)) * (rng.random((2, 3)) < 0.8)


def in_box(rng: np.random.Generator, frame: np.ndarray, half: np.ndarray) -> np.ndarray:
    local = rng.uniform(-1, 1, (400, 3)) * half
    return np.asarray(local @ frame[:3, :3].T + frame[:3, 3])


@for_all(few=50, many=3000, seed=seeds, scale=scales, offset=offsets)
def test_the_gap_between_boxes_is_no_more_than_their_distance_and_moves_with_them(seed, scale, offset) -> None:
    rng = np.random.default_rng(seed)
    frames, half = two_boxes(rng)
    gap = box_gap(frames[0], half[0], frames[1], half[1])
    a, b = (in_box(rng, frame, size) for frame, size in zip(frames, half, strict=True))
    assert gap <= np.linalg.norm(a[:, None] - b, axis=2).min() + 8 * EPS
    assert box_gap(frames[1], half[1], frames[0], half[0]) == pytest.approx(gap, abs=128 * EPS)
    moved = frames.copy()
    moved[:, :3, 3] = frames[:, :3, 3] * scale + offset
    assert np.abs(box_gap(moved[0], half[0] * scale, moved[1], half[1] * scale) - gap * scale) <= 32 * EPS * (
        np.abs(offset).max() + 8 * scale
    )


@for_all(few=50, many=3000, seed=seeds, tilt=st.floats(-9, -2).map(lambda e: 10.0**e))
def test_edges_that_are_nearly_parallel_cost_a_thousandth_of_the_boxes_size(seed, tilt) -> None:
    """Whether the cross product of two edges is an axis or no longer one (`PARALLEL`), beside boxes whose edges are parallel."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.1, 1, (2, 3))
    parallel = trimesh.transformations.rotation_matrix(rng.uniform(0, 6), [0, 0, 1])
    parallel[:3, 3] = rng.normal(size=3)
    tilted = parallel.copy()
    tilted[:3, :3] = parallel[:3, :3] @ trimesh.transformations.rotation_matrix(tilt, rng.normal(size=3))[:3, :3]
    before, after = (box_gap(np.eye(4), half[0], frame, half[1]) for frame in (parallel, tilted))
    assert after >= before - 4 * tilt
    if before < 0:
        assert after <= before + 4 * tilt


def test_boxes_that_touch_or_coincide() -> None:
    half, frame = np.array([0.1, 0.2, 0.3]), np.eye(4)
    beside = np.eye(4)
    beside[0, 3] = 0.2
    assert box_gap(frame, half, beside, half) == pytest.approx(0, abs=4 * EPS)
    assert box_gap(frame, half, frame, half) == pytest.approx(-0.2)
    assert box_gap(frame, 0 * half, frame, 0 * half) == 0


def with_collision(vertices: np.ndarray) -> Hand:
    """The hand with one link, whose collision shape has the given corners."""
    link = next(link for link in HAND.links if link.collisions)
    shape = replace(link.collisions[0], kind="mesh", origin=np.eye(4), mesh=Mesh.bare(vertices, np.array([[0, 1, 2], [1, 2, 3]])))
    return replace(HAND, links=(replace(link, collisions=(shape,)),))


def test_a_flat_collision_shape_is_named() -> None:
    flat = with_collision(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    with pytest.raises(InvalidInput, match=r"allegro_right\.urdf: collision shape mesh .* of link \S+ is flat or not finite"):
        collision_balls(flat, 0.1)


@for_all(few=5, many=200, seed=seeds, scale=scales)
def test_balls_fill_a_body_of_any_size(seed, scale) -> None:
    """They reach all of its corners and leave it nowhere."""
    corners = np.random.default_rng(seed).normal(size=(4, 3))
    hand = with_collision(corners * scale)
    balls, (frame,), (half,) = collision_balls(hand, 0.3 * scale), collision_boxes(hand).frames, collision_boxes(hand).half
    reach = np.abs(balls.centres - frame[:3, 3]) + balls.radii[:, None]
    assert (reach <= half + 1e-9 + 1e-12 * scale).all()
    nearest = np.linalg.norm(balls.centres[:, None] - corners * scale, axis=2).min(axis=0)
    assert nearest.max() <= 1e-9 + 1e-9 * scale


def test_depth_in_an_object_whose_cells_are_larger_than_the_hand() -> None:
    """The grid is too coarse to see anything; what is measured is exact all the same."""
    block = trimesh.creation.box((4.0, 4.0, 4.0)).apply_translation((0, 0, -2.0))
    field = distance_field(block.vertices, block.faces, 0.3, 0.4)
    palm = collision_balls(HAND, 0.006).of([0])
    for height in (-0.003, -0.05, 0.02):
        pose = tangent_pose(HAND, np.zeros(3), np.array([0, 0, 1.0]), height, 0.3)
        lowest = (palm.centres @ pose[2, :3] + pose[2, 3] - palm.radii).min()
        assert deepest(field, palm, np.tile(pose, (len(HAND.links), 1, 1))) == pytest.approx(max(0, -lowest), abs=1e-12)


@for_all(few=8, many=300, seed=seeds, offset=offsets)
def test_contact_and_clearance_far_away_lose_what_float32_loses(seed, offset) -> None:
    """A hand over the upper side of a block four metres wide, where distance is height."""
    pose, angles = posture(np.random.default_rng(seed), offset + [0, 0, 0.1])
    frames = forward(HAND, pose[None], angles[None])
    block = trimesh.creation.box((4.0, 4.0, 4.0)).apply_translation(offset - [0, 0, 2.0])
    field = distance_field(block.vertices, block.faces, 0.3, 0.6)
    balls = collision_balls(HAND, 0.02)
    parts, lost = finger_parts(HAND, balls, 0.016, 0.007), 2.0**-20 * (np.abs(offset).max() + 1)
    exact = ball_points(balls, frames)
    assert np.abs(ball_points(balls, frames.astype(np.float32)) - exact).max() <= lost / 4
    clearance, (contact, _) = finger_clearance(field, parts, frames), gel_contact(field, gel_probes(HAND, parts, frames), 0.0)
    for number, finger in enumerate(HAND.fingers):
        own = np.isin(balls.link, finger.links)
        lowest = (exact[2, 0, own] - offset[2] - balls.radii[own]).min()
        assert abs(clearance[0, number] - lowest) <= lost
        probes = (frames[0, finger.tip] @ np.vstack([parts.probes[number].T, np.ones(parts.probes.shape[1])]))[2] - offset[2]
        assert abs(contact[0, number] - probes.min()) <= lost


def test_nothing_to_choose_from() -> None:
    boxes = collision_boxes(HAND)
    frames = forward(HAND, np.eye(4), np.clip(np.zeros((2, 16)), HAND.lower, HAND.upper))
    assert choose_together(HAND, boxes, frames, np.full((2, 4), -np.inf), 0.0) is None
    assert choose_together(HAND, boxes, frames[:0], np.zeros((0, 4)), 0.0) is None
    nothing = Boxes(np.zeros((0, 4, 4)), np.zeros((0, 3)), np.zeros(0, np.intp))
    assert choose_together(HAND, nothing, frames, np.array([[0.0, 1, 0, 1], [1, 0, 1, 0]]), 0.0).tolist() == [1, 0, 1, 0]
