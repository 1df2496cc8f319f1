"""Forward kinematics: link and sensor frames from joint angles."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import compose, sin_cos, transform_points
from pipeline.kernels.hand.model import Hand
from pipeline.rng import numpy_rng

RANDOM_POSTURES = 512  # of which the widest gives how far a hand opens


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
    values = {link: joint_angles[..., entry] for entry, link in enumerate(hand.joint_links)}
    values |= {follower.link: follower.of(joint_angles) for follower in hand.followers}
    for joint in hand.joints:  # parents first
        frame = compose(frames[..., joint.parent, :, :], joint.origin)
        if joint.child in values:
            frame = compose(frame, joint_motion(joint.kind, joint.axis, values[joint.child]))
        frames[..., joint.child, :, :] = frame
    return frames


def joint_motion(
    kind: str,  # of the joint
    axis: Array,  # (3,) unit vector
    value: ArrayLike,  # (...) rad, of a prismatic joint m
) -> Array:  # (..., 4, 4)
    """Compute the displacement of a joint: Rodrigues' formula, or a slide along the axis."""
    value = np.asarray(value, np.float64)[..., None, None]
    motion = np.broadcast_to(np.eye(4), (*value.shape[:-2], 4, 4)).copy()
    if kind == "prismatic":
        motion[..., :3, 3:] = value * np.asarray(axis, np.float64)[:, None]
        return motion
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    square = np.array([[-z * z - y * y, x * y, x * z], [x * y, -z * z - x * x, y * z], [x * z, y * z, -y * y - x * x]])
    sin, cos = sin_cos(value)
    motion[..., :3, :3] += sin * cross + (1 - cos) * square
    return motion


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
