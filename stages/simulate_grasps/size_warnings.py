"""Warnings of objects that are too small or too large for the hand."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from pipeline.console import abbreviate, pluralise
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.model import Hand
from pipeline.rng import numpy_rng

POSTURES = 512
"""Random postures, of which the widest gives how far a hand opens."""


def size_warnings(
    extents: Mapping[str, np.ndarray],  # (3,) sides of each object's bounding box, m
    *,
    smallest: float,  # m, least longest side of an object that fits
    largest: float,  # m, greatest shortest side of one that fits
    hand: str,  # its name
) -> Iterator[str]:
    """Name the objects that are too small or too large for a hand."""
    small = [name for name, sides in extents.items() if sides.max() < smallest]
    large = [name for name, sides in extents.items() if sides.min() > largest]
    if small:
        yield (
            f"{pluralise(len(small))} smaller than two sensors of {hand} side by side, {1e3 * smallest:.0f} mm ({abbreviate(small)}): "
            "is the unit right?"
        )
    if large:
        yield (
            f"{pluralise(len(large))} wider on every side than {hand} opens, {1e3 * largest:.0f} mm ({abbreviate(large)}): fingers touch "
            "one side only, if any; is the unit right?"
        )


def sensor_positions(hand: Hand) -> NDArray[np.float64]:
    """Compute the positions (P, S, 3) of the sensors in random postures and at the joints' limits, frame of the palm's link, m."""
    return sensor_poses_from_links(hand, _frames(hand))[..., :3, 3]


def opening(hand: Hand) -> float:
    """Compute how far a hand opens: the greatest distance between two of its sensors, or one and the palm's centre, m.

    Of a hand with fewer than two sensors on its fingers, the middles of the fingers' last links count too.
    """
    frames = _frames(hand)
    positions, palm = sensor_poses_from_links(hand, frames)[..., :3, 3], np.broadcast_to(hand.palm_centre, (len(frames), 1, 3))
    ends = np.concatenate([positions, palm, *(_last_links(hand, frames) if (hand.sensor_fingers >= 0).sum() < 2 else ())], axis=1)
    return float(np.linalg.norm(ends[:, :, None] - ends[:, None], axis=-1).max())


def _frames(hand: Hand) -> NDArray[np.float64]:
    """Compute the poses of all links in random postures and at the joints' limits: (P, L, 4, 4)."""
    angles = numpy_rng(0, "opening", hand.name).uniform(hand.lower, hand.upper, (POSTURES, len(hand.lower)))
    return forward_kinematics(hand, np.eye(4), np.concatenate([angles, [hand.lower, hand.upper]]))


def _last_links(hand: Hand, frames: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Compute where the middle of each finger's last link is, (P, 1, 3), m, with the links' poses (P, L, 4, 4)."""
    carry = {joint.parent for joint in hand.joints}
    for link in np.flatnonzero(hand.link_fingers >= 0).tolist():
        if link not in carry and (shapes := hand.links[link].collisions):
            corners = np.concatenate([shape.mesh.vertices for shape in shapes])
            yield transform_points(frames[:, link], (corners.min(axis=0) + corners.max(axis=0))[None] / 2)
