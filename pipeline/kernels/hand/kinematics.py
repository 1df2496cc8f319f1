"""Forward kinematics: link and sensor frames from joint angles."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.compiled import compiled, for_few
from pipeline.kernels.geometry.transforms import compose, sin_cos, transform_points
from pipeline.kernels.hand.model import Hand
from pipeline.rng import numpy_rng

RANDOM_POSTURES = 512  # of which the widest gives how far a hand opens
FEW_POSTURES = 8  # whose frames take a few milliseconds uncompiled


def forward_kinematics(
    hand: Hand,
    hand_pose: Array,  # (..., 4, 4) frame of the root link in the world, m
    joint_angles: Array,  # (..., J) rad (m for a prismatic joint), in the order of `hand.joint_names`
) -> Array:  # (..., L, 4, 4) world, m, in the order of `hand.links`
    """Compute the URDF frames of all links; leading dimensions broadcast."""
    if np.shape(joint_angles)[-1:] != (len(hand.joint_names),):
        shape, expected = np.shape(joint_angles), len(hand.joint_names)
        raise ValueError(f"joint_angles have shape {shape}; the last dimension must be {expected}, the joints of {hand.name}")
    if np.shape(hand_pose)[-2:] != (4, 4):
        raise ValueError(f"hand_pose has shape {np.shape(hand_pose)}; its last dimensions must be 4 × 4")
    if not (np.isfinite(joint_angles).all() and np.isfinite(hand_pose).all()):
        raise ValueError(f"joint_angles or hand_pose of {hand.name} hold NaN or infinity; a posture needs finite ones")
    batch = np.broadcast_shapes(np.shape(hand_pose)[:-2], np.shape(joint_angles)[:-1])
    frames = np.empty((*batch, len(hand.links), 4, 4))
    frames[..., 0, :, :] = hand_pose
    tree = _joint_tree(hand)
    values = np.broadcast_to(joint_angles, (*batch, len(hand.joint_names)))[..., tree.entry] * tree.multiplier + tree.offset
    values = values.reshape(-1, len(tree.entry))
    follow = for_few(_follow_joints) if len(values) <= FEW_POSTURES else _follow_joints
    follow(frames.reshape(-1, *frames.shape[-3:]), tree, values, *sin_cos(values))
    return frames


class _JointTree(NamedTuple):
    """A hand's tree as the compiled loop takes it: all joints, parents first, and the M that move."""

    parent: Indices
    child: Indices
    origin: Array
    axis: Array
    slides: Mask
    moving: Indices  # number of each joint among those that move, -1 where it is fixed
    entry: Indices  # (M,) entry of the joint vector that each follows
    multiplier: Array  # (M,)
    offset: Array  # (M,)


@lru_cache(maxsize=16)
def _joint_tree(hand: Hand) -> _JointTree:
    links = [*hand.joint_links, *(follower.link for follower in hand.followers)]
    entries, joints, followers = len(hand.joint_links), hand.joints, hand.followers
    return _JointTree(
        parent=np.array([joint.parent for joint in joints], np.intp),
        child=np.array([joint.child for joint in joints], np.intp),
        origin=np.array([joint.origin for joint in joints]).reshape(-1, 4, 4),
        axis=np.array([joint.axis for joint in joints], np.float64).reshape(-1, 3),
        slides=np.array([joint.kind == "prismatic" for joint in joints], np.bool_),
        moving=np.array([links.index(joint.child) if joint.child in links else -1 for joint in joints], np.intp),
        entry=np.array([*range(entries), *(follower.entry for follower in followers)], np.intp),
        multiplier=np.array([1.0] * entries + [follower.multiplier for follower in followers]),
        offset=np.array([0.0] * entries + [follower.offset for follower in followers]),
    )


@compiled
def _follow_joints(frames: Array, tree: _JointTree, values: Array, sin: Array, cos: Array) -> None:
    """Fill the link frames (N, L, 4, 4), except the root's, from the values (N, M) of the moving joints."""
    resting_frame, motion = np.empty((4, 4)), np.empty((4, 4))
    for n in range(len(frames)):
        for j in range(len(tree.parent)):
            frame, m = frames[n, tree.child[j]], tree.moving[j]
            if m < 0:
                _multiply(frames[n, tree.parent[j]], tree.origin[j], frame)
            else:
                _multiply(frames[n, tree.parent[j]], tree.origin[j], resting_frame)
                _set_motion(motion, tree.slides[j], tree.axis[j], values[n, m], sin[n, m], cos[n, m])
                _multiply(resting_frame, motion, frame)


@compiled
def combine_frames(pose: Array, frames: Array, rows: Indices) -> Array:  # (N, L, 4, 4)
    """Compose a pose (4, 4) with frames (K, L, 4, 4), in combination n with that of row `rows[n, l]` (N, L) for link l."""
    combined = np.empty((rows.shape[0], rows.shape[1], 4, 4))
    for n in range(rows.shape[0]):
        for link in range(rows.shape[1]):
            _multiply(pose, frames[rows[n, link], link], combined[n, link])
    return combined


@compiled
def _multiply(left: Array, right: Array, product: Array) -> None:
    """Multiply matrices (4, 4), with the bits of `compose`."""
    for row in range(4):
        for col in range(4):
            product[row, col] = (
                left[row, 0] * right[0, col] + left[row, 1] * right[1, col] + left[row, 2] * right[2, col] + left[row, 3] * right[3, col]
            )


@compiled
def _set_motion(motion: Array, slides: bool, axis: Array, value: float, sin: float, cos: float) -> None:
    """Fill `motion` (4, 4) with the displacement of a joint: Rodrigues' formula, or a slide along the axis."""
    x, y, z = axis
    motion[:] = 0
    motion[3, 3] = 1
    if slides:
        sin, cos = 0.0, 1.0
        motion[0, 3], motion[1, 3], motion[2, 3] = value * x, value * y, value * z
    rest = 1 - cos
    motion[0, 0], motion[0, 1], motion[0, 2] = 1 + rest * (-z * z - y * y), sin * -z + rest * (x * y), sin * y + rest * (x * z)
    motion[1, 0], motion[1, 1], motion[1, 2] = sin * z + rest * (x * y), 1 + rest * (-z * z - x * x), sin * -x + rest * (y * z)
    motion[2, 0], motion[2, 1], motion[2, 2] = sin * -y + rest * (x * z), sin * x + rest * (y * z), 1 + rest * (-y * y - x * x)


def sensor_poses(hand: Hand, hand_pose: Array, joint_angles: Array) -> Array:
    """Compute the sensor frames of postures, (..., S, 4, 4), from what `forward_kinematics` takes."""
    return sensor_poses_from_links(hand, forward_kinematics(hand, hand_pose, joint_angles))


def sensor_poses_from_links(hand: Hand, link_frames: Array) -> Array:
    """Compute the sensor frames (..., S, 4, 4) of a hand from its link frames (..., L, 4, 4), world, m."""
    return np.stack([compose(link_frames[..., mount.link, :, :], mount.pose) for mount in hand.sensors], axis=-3)


def sensor_positions(hand: Hand) -> Array:  # (P, S, 3) frame of the root link, m
    """Compute where sensors are in random postures and at the joints' limits."""
    return sensor_poses_from_links(hand, _random_frames(hand))[..., :3, 3]


def opening(hand: Hand) -> float:
    """Compute how far a hand opens: the greatest distance between two of its sensors, or one and the palm's centre, m.

    Of a hand with fewer than two sensors on its fingers, the middles of the fingers' last links count too.
    """
    frames = _random_frames(hand)
    ends = [sensor_poses_from_links(hand, frames)[..., :3, 3], np.broadcast_to(hand.palm_centre, (len(frames), 1, 3))]
    if (hand.sensor_fingers >= 0).sum() < 2:
        parents = {joint.parent for joint in hand.joints}
        for number in np.flatnonzero(hand.link_fingers >= 0).tolist():
            if number not in parents and (shapes := hand.links[number].collisions):
                corners = np.concatenate([shape.mesh.vertices for shape in shapes])
                ends.append(transform_points(frames[:, number], (corners.min(axis=0) + corners.max(axis=0))[None] / 2))
    points = np.concatenate(ends, axis=1)
    return float(np.linalg.norm(points[:, :, None] - points[:, None], axis=-1).max())


def _random_frames(hand: Hand) -> Array:
    """Compute the link frames (P, L, 4, 4) of random postures, and at the joints' limits."""
    angles = numpy_rng(0, "opening", hand.name).uniform(hand.lower, hand.upper, (RANDOM_POSTURES, len(hand.lower)))
    return forward_kinematics(hand, np.eye(4), np.concatenate([angles, [hand.lower, hand.upper]]))


def joint_motion(kind: str, axis: Array, value: float) -> Array:
    """Compute the displacement (4, 4) of a joint by a value, rad (m if prismatic), about or along a unit axis (3,)."""
    motion = np.empty((4, 4))
    _set_motion(motion, kind == "prismatic", np.asarray(axis, np.float64), float(value), *map(float, sin_cos(value)))
    return motion
