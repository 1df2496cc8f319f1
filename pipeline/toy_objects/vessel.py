"""What bottles are made of: bodies, labels wrapped on them, caps. Lengths in millimetres, the front faces -y."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.toy_objects.shapes import Solid, loft, revolve, rod, smooth, superellipse

Rows = Sequence[Sequence[float]]


def body(rows: Rows, dent: float = 0.0, bore: float = 0.0, count: int = 48, ripple: tuple[int, float] = (0, 0.0)) -> Solid:
    """Bottle body from rows (z, half width, half depth, exponent), smoothed.

    `dent` lifts the centre of the bottom; `bore` > 0 opens the mouth: a hole so deep, its wall a quarter of the mouth's
    radius; `ripple` (lobes, depth) flutes the lower half.
    """
    table = smooth(rows)
    rings = _rings(table, count)
    lobes, depth = ripple
    if lobes:
        t = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
        span = (table[:, 0] - table[0, 0]) / (table[-1, 0] - table[0, 0])
        strength = depth * np.sin(np.pi * np.clip(span / 0.55, 0.0, 1.0)) ** 2
        rings[..., :2] *= (1.0 + strength[:, None] * np.cos(lobes * t))[..., None]
    bottom = rings[0].mean(axis=0) + np.array([0.0, 0.0, dent])
    if bore > 0.0:
        inner = np.array([1.0, 1.0, 0.0]) * (0.75 * rings[-1]) + [0.0, 0.0, table[-1, 0]]
        rings = np.concatenate([rings, inner[None], inner[None] - [0.0, 0.0, bore]])
    return loft(rings, bottom)


def _rings(table: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    flat = superellipse(table[:, 1], table[:, 2], table[:, 3], count)
    return np.concatenate([flat, np.broadcast_to(table[:, :1, None], (*flat.shape[:2], 1))], axis=-1)


def wrap(rows: Rows, low: float, high: float, width: float, proud: float = 0.5) -> Solid:
    """A label on the front of a `body` of the same rows, from z `low` to `high`, `width` radians wide about -y.

    It stands `proud` mm out of the body and reaches well inside, with a straight back. The picture fills it, upright,
    u to the right.
    """
    table = smooth(rows)
    gap = 0.02 * (high - low)  # no slivers at the ends
    z = table[(table[:, 0] > low + gap) & (table[:, 0] < high - gap), 0]  # the body's rings: no coming through
    z = np.concatenate([[low], z, [high]])
    a, b, exponent = (np.interp(z, table[:, 0], table[:, i])[:, None] for i in (1, 2, 3))
    angle = np.linspace(-width / 2.0, width / 2.0, 33)
    c, s = np.sin(angle), -np.cos(angle)
    reach = (np.abs(c / (a + proud)) ** exponent + np.abs(s / (b + proud)) ** exponent) ** (-1.0 / exponent)  # (z, angle)
    inside = np.broadcast_to(0.45 * reach.min(axis=0), reach.shape)  # straight, so that the ends are star-shaped
    outline = np.concatenate([reach, inside[::-1]]).T  # (angle, 2 z): one closed strip an angle
    height = np.broadcast_to(np.concatenate([z, z[::-1]]), outline.shape)
    strip = np.stack([outline * c[:, None], outline * s[:, None], height], axis=-1)
    solid = loft(strip)
    u = np.repeat((angle / width + 0.5)[:, None], outline.shape[1], axis=1).ravel()
    flat = np.column_stack([np.concatenate([u, [0.0, 1.0]]), (solid.vertices[:, 2] - low) / (high - low)])
    return Solid(solid.vertices, solid.faces, flat)


def screw_cap(z: float, radius: float, height: float, ridges: int = 24) -> Solid:
    """Knurled cap standing on z, its top edge rounded."""
    edge = min(0.2 * height, 0.25 * radius)
    rows = [(z, radius), (z + 0.5 * height, radius), (z + height - edge, radius)]
    rows += [(z + height - 0.3 * edge, radius - 0.3 * edge), (z + height, radius - edge)]
    return revolve(rows, count=3 * ridges, lobes=ridges, depth=0.025)


def crown_cap(z: float, radius: float) -> Solid:
    """Crimped beer cap over a mouth at height z."""
    rows = [
        (z - 5.5, 1.2 * radius),
        (z - 4.5, 1.22 * radius),
        (z - 1.0, 1.08 * radius),
        (z + 1.5, radius),
        (z + 2.2, 0.85 * radius),
    ]
    return revolve(rows, count=84, lobes=21, depth=0.04)


def cork(z: float, radius: float, height: float) -> Solid:
    """Cork stuck in a mouth at height z, standing out by `height`."""
    return rod(z - 1.5 * height, z + height, radius, "z", bevel=0.15)


def round_rows(*pairs: Sequence[float]) -> list[tuple[float, float, float, float]]:
    """Body rows of a round bottle from pairs (z, radius)."""
    return [(z, r, r, 2.0) for z, r in pairs]
