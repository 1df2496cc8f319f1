"""Forward kinematics: link and sensor frames from joint angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose, sin_cos
from pipeline.kernels.hand.model import Hand


def forward_kinematics(hand: Hand, hand_pose: NDArray[np.float64], joint_angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the frames of all links.

    Parameters
    ----------
    hand
        L links, J joints that move.
    hand_pose
        (..., 4, 4) frame of the root link in the world.
    joint_angles
        (..., J) rad (m for a prismatic joint), in the order of `hand.joint_names`; leading dimensions broadcast against the pose's.

    Returns
    -------
    (..., L, 4, 4) float64, the URDF frame of every link in the world, in the order of `hand.links`.

    Raises
    ------
    ValueError
        A shape is wrong, or a value is NaN or infinite.
    """
    if np.shape(joint_angles)[-1:] != (len(hand.joint_names),):
        have, wanted = np.shape(joint_angles), len(hand.joint_names)
        raise ValueError(f"joint_angles have shape {have}; the last dimension must be {wanted}, the joints of {hand.name}")
    if np.shape(hand_pose)[-2:] != (4, 4):
        raise ValueError(f"hand_pose has shape {np.shape(hand_pose)}; its last dimensions must be 4 × 4")
    if not (np.isfinite(joint_angles).all() and np.isfinite(hand_pose).all()):
        raise ValueError(f"joint_angles or hand_pose of {hand.name} hold NaN or infinity; a posture needs finite ones")
    batch = np.broadcast_shapes(np.shape(hand_pose)[:-2], np.shape(joint_angles)[:-1])
    frames = np.empty((*batch, len(hand.links), 4, 4))
    frames[..., 0, :, :] = hand_pose
    values = {link: joint_angles[..., j] for j, link in enumerate(hand.joint_links)}
    values |= {follower.link: follower.multiplier * joint_angles[..., follower.entry] + follower.offset for follower in hand.followers}
    for joint in hand.joints:  # parents first
        frame = compose(frames[..., joint.parent, :, :], joint.origin)
        if joint.child in values:
            frame = compose(frame, joint_motion(joint.kind, joint.axis, values[joint.child]))
        frames[..., joint.child, :, :] = frame
    return frames


def sensor_poses(hand: Hand, hand_pose: NDArray[np.float64], joint_angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the sensor frames of postures.

    Parameters
    ----------
    hand, hand_pose, joint_angles
        As for `forward_kinematics`.

    Returns
    -------
    (..., S, 4, 4) float64, sensor frame to world frame, m, in the order of `hand.sensors`.

    Raises
    ------
    ValueError
        As `forward_kinematics`.
    """
    return sensor_poses_from_links(hand, forward_kinematics(hand, hand_pose, joint_angles))


def sensor_poses_from_links(hand: Hand, link_frames: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the sensor frames of a hand from its link frames.

    Parameters
    ----------
    hand
        Gives the S sensors and their links.
    link_frames
        (..., L, 4, 4) float64, world, m, from `forward_kinematics`.

    Returns
    -------
    (..., S, 4, 4) float64, sensor frame to world frame, m, in the order of `hand.sensors`.
    """
    return np.stack([compose(link_frames[..., mount.link, :, :], mount.pose) for mount in hand.sensors], axis=-3)


def joint_motion(kind: str, axis: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the displacement of a joint: Rodrigues' formula, or a slide along the axis.

    Parameters
    ----------
    kind
        "prismatic", or a kind that turns.
    axis
        (3,) unit vector.
    value
        (...) rad, of a prismatic joint m.

    Returns
    -------
    (..., 4, 4) float64.
    """
    motion = np.broadcast_to(np.eye(4), (*np.shape(value), 4, 4)).copy()
    if kind == "prismatic":
        motion[..., :3, 3] = value[..., None] * axis
        return motion
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sin, cos = (part[..., None, None] for part in sin_cos(value))
    motion[..., :3, :3] += sin * cross + (1 - cos) * compose(cross, cross)
    return motion
