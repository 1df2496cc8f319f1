"""Forward kinematics: link and sensor frames from joint angles."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose, sin_cos
from pipeline.kernels.hand.model import Hand


def forward(hand: Hand, hand_pose: NDArray[np.float64], joint_angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Frames of all links.

    Parameters
    ----------
    hand
        L links, J joints.
    hand_pose
        (..., 4, 4) frame of the root link in the world.
    joint_angles
        (..., J) rad, in the order of `hand.joint_names`; leading dimensions broadcast against the pose's.

    Returns
    -------
    (..., L, 4, 4) float64, the URDF frame of every link in the world, in the order of `hand.links`: rotations within 1e-14,
    positions within 1e-15 m plus 4 units in the last place of the hand's distance from the origin.
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
    chain_forward(hand, frames, joint_angles, range(1, len(hand.links)))
    return frames


def chain_forward(hand: Hand, frames: NDArray[np.float64], joint_angles: NDArray[np.float64], links: Iterable[int]) -> None:
    """Fill the given links' `frames` (..., L, 4, 4) in place from their parents'; links in tree order, angles (..., J)."""
    entry = {link: j for j, link in enumerate(hand.joint_links)}
    for link in links:
        joint = hand.joints[link - 1]
        frame = compose(frames[..., joint.parent, :, :], joint.origin)
        if link in entry:
            frame = compose(frame, _motion(joint.kind, joint.axis, joint_angles[..., entry[link]]))
        frames[..., link, :, :] = frame


def sensor_poses(hand: Hand, hand_pose: NDArray[np.float64], joint_angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., S, 4, 4) float64 sensor frames P in the world; arguments as for `forward`."""
    return sensors_on(hand, forward(hand, hand_pose, joint_angles))


def sensors_on(hand: Hand, frames: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., S, 4, 4) float64 sensor frames P in the world, of a hand whose link frames are (..., L, 4, 4)."""
    return np.stack([compose(frames[..., f.tip, :, :], f.sensor_pose) for f in hand.fingers], axis=-3)


def _motion(kind: str, axis: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 4, 4) displacement of a joint: Rodrigues' formula, or a slide along the axis."""
    motion = np.broadcast_to(np.eye(4), (*np.shape(value), 4, 4)).copy()
    if kind == "prismatic":
        motion[..., :3, 3] = value[..., None] * axis
        return motion
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sin, cos = (part[..., None, None] for part in sin_cos(value))
    motion[..., :3, :3] += sin * cross + (1 - cos) * compose(cross, cross)
    return motion
