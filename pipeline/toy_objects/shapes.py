"""Closed solids out of cross-sections: every part of a procedural object is a `loft`.

Lengths are whatever the caller uses (the recipes use millimetres); z is up. Every solid is one closed, outward-wound
manifold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
AXES = {"x": 0, "y": 1, "z": 2}
AXIS_ORDER = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}  # cyclic, so that handedness stays


@dataclass(frozen=True)
class Solid:
    """One closed part: `vertices` (V, 3), outward-wound `faces` (F, 3), texture coordinates `uv` (V, 2) in [0, 1]."""

    vertices: Array
    faces: NDArray[np.int32]
    uv: Array

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        """The solid shifted."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def turned(self, axis: str, angle: float, about: Sequence[float] = (0.0, 0.0, 0.0)) -> Solid:
        """The solid rotated by `angle` (rad, right-handed) about the line along `axis` through `about`."""
        j, k = (AXES[axis] + 1) % 3, (AXES[axis] + 2) % 3
        turn = np.eye(3)
        turn[[j, j, k, k], [j, k, j, k]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        return replace(self, vertices=(self.vertices - about) @ turn.T + about)

    def projected(self, u: str, v: str, window: Sequence[float] = (0.0, 0.0, 1.0, 1.0)) -> Solid:
        """The solid with a picture laid on it flat: bounds along `u` and `v` fill the uv `window` (u0, v0, u1, v1)."""
        flat = self.vertices[:, [AXES[u], AXES[v]]]
        low, high = flat.min(axis=0), flat.max(axis=0)
        corner, far = np.array(window[:2]), np.array(window[2:])
        return replace(self, uv=corner + (flat - low) / (high - low) * (far - corner))


def loft(rings: Array, first: ArrayLike | None = None, last: ArrayLike | None = None) -> Solid:
    """Skin over cross-sections, closed by two fans.

    Parameters
    ----------
    rings
        (S, N, 3) S >= 2 cross-sections of N points each, star-shaped about the centres of the caps.
    first, last
        (3,) the centres of the two caps, the ring's mean if None; off its plane they make a point or a dent.
    """
    count, around = rings.shape[:2]
    centres = [rings[end].mean(axis=0) if p is None else np.asarray(p, float) for end, p in ((0, first), (-1, last))]
    near = np.arange(count * around, dtype=np.int32).reshape(count, around)
    side = np.roll(near, -1, axis=1)
    a, b, c, d = near[:-1].ravel(), side[:-1].ravel(), side[1:].ravel(), near[1:].ravel()
    bottom, top = (np.full(around, count * around + i, np.int32) for i in range(2))
    corners = [(a, b, c), (a, c, d), (bottom, side[0], near[0]), (top, near[-1], side[-1])]
    faces = np.concatenate([np.stack(t, axis=1) for t in corners])
    vertices = np.concatenate([rings.reshape(-1, 3), np.stack(centres)])
    p, q, r = (vertices[faces[:, i]] - centres[0] for i in range(3))
    if np.einsum("ij,ij->", p, np.cross(q, r)) < 0.0:  # six times the signed volume
        faces = faces[:, ::-1]
    return Solid(vertices, np.ascontiguousarray(faces), np.zeros((len(vertices), 2)))


def superellipse(a: ArrayLike, b: ArrayLike, exponent: ArrayLike = 2.0, count: int = 24) -> Array:
    """(..., count, 2) points of |x/a|^n + |y/b|^n = 1: an ellipse for exponent 2, nearly a rectangle for 8."""
    t = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    power = 2.0 / np.asarray(exponent, float)[..., None]
    x, y = (np.sign(w) * np.abs(w) ** power for w in (np.cos(t), np.sin(t)))
    return np.stack(np.broadcast_arrays(np.asarray(a)[..., None] * x, np.asarray(b)[..., None] * y), axis=-1)


def smooth(rows: ArrayLike, between: int = 4) -> Array:
    """Table whose first column rises, refined to `between` steps a row by monotone cubics."""
    table = np.asarray(rows, float)
    steps = np.arange((len(table) - 1) * between + 1) / between
    where = np.interp(steps, np.arange(len(table)), table[:, 0])
    return np.column_stack([where, PchipInterpolator(table[:, 0], table[:, 1:])(where)])


def revolve(profile: ArrayLike, axis: str = "z", count: int = 32, lobes: int = 0, depth: float = 0.0) -> Solid:
    """Turned part: rows (position along the axis, radius), from one end to the other, perhaps back down inside.

    `lobes` ripples of relative `depth` around it make crimped or knurled rims.
    """
    rows = np.asarray(profile, float)
    t = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    radius = rows[:, 1, None] * (1.0 + depth * np.cos(lobes * t))
    along = np.broadcast_to(rows[:, 0, None], radius.shape)
    rings = np.stack([radius * np.cos(t), radius * np.sin(t), along], axis=-1)
    return loft(rings[..., AXIS_ORDER[axis]])


def rod(start: float, end: float, radius: float, axis: str = "x", bevel: float = 0.1, count: int = 24) -> Solid:
    """Round bar along an axis with edges broken by `bevel` of its radius."""
    b = min(bevel * radius, 0.4 * (end - start))
    rows = [(start, radius - b), (start + b, radius), (end - b, radius), (end, radius - b)]
    return revolve(rows, axis, count)


def ball(radii: Sequence[float], count: int = 16) -> Solid:
    """Ellipsoid about the origin."""
    t = np.linspace(0.0, np.pi, count // 2 + 2)[1:-1]
    solid = revolve(np.column_stack([-np.cos(t), np.sin(t)]), "z", count)
    return replace(solid, vertices=solid.vertices * radii)


def bar(rows: ArrayLike, exponent: float = 4.0, count: int = 24) -> Solid:
    """Bar along x: rows (x, bottom z, top z, width along y), cross-sections upright superellipses."""
    x, low, high, width = np.asarray(rows, float).T
    flat = superellipse(width / 2.0, (high - low) / 2.0, exponent, count)
    flat[..., 1] += (high + low)[:, None] / 2.0
    return loft(np.concatenate([np.broadcast_to(x[:, None, None], (*flat.shape[:2], 1)), flat], axis=-1))


def sweep(
    path: ArrayLike,
    width: ArrayLike,
    height: ArrayLike,
    exponent: float = 2.0,
    side: Sequence[float] = (0.0, 1.0, 0.0),
    count: int = 16,
) -> Solid:
    """Bar along a path (S, 3) that lies across `side`: `width` along it, `height` across, each a number or (S,)."""
    line = np.asarray(path, float)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    up = np.cross(tangent, side)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    half = [np.broadcast_to(np.asarray(w, float) / 2.0, len(line)) for w in (width, height)]
    flat = superellipse(half[0], half[1], exponent, count)
    return loft(line[:, None] + flat[..., :1] * np.asarray(side) + flat[..., 1:] * up[:, None])


def tube(path: ArrayLike, radius: float, side: Sequence[float] = (0.0, 1.0, 0.0), count: int = 12) -> Solid:
    """Round wire of one radius along a path that lies across `side`."""
    return sweep(path, 2.0 * radius, 2.0 * radius, 2.0, side, count)


def curve(points: Sequence[Sequence[float]], count: int = 16) -> Array:
    """(count, D) points evenly along a smooth curve through `points`, by chord length."""
    knots = np.array(points, float)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    return np.asarray(PchipInterpolator(length, knots)(np.linspace(0.0, length[-1], count)))


def rounded_rectangle(width: float, height: float, radius: float, steps: int = 5) -> Array:
    """(4 * (steps + 1), 2) outline about the origin, counter-clockwise, corners of `radius`."""
    r = min(radius, 0.49 * min(width, height))
    t = np.linspace(0.0, np.pi / 2.0, steps + 1)
    corner = np.stack([np.cos(t), np.sin(t)], axis=1) * r + [width / 2.0 - r, height / 2.0 - r]
    x, y = corner.T
    quarters = [np.stack(q, axis=1) for q in ((x, y), (-x[::-1], y[::-1]), (-x, -y), (x[::-1], -y[::-1]))]
    return np.concatenate(quarters)


def rounded_box(size: Sequence[float], corner: float, bevel: float, axis: str = "y", steps: int = 5) -> Solid:
    """Box about the origin of `size` (x, y, z): outline across `axis` rounded by `corner`, its two faces by `bevel`."""
    order = AXIS_ORDER[axis]
    local = [size[order.index(i)] for i in range(3)]
    t = np.linspace(0.0, np.pi / 2.0, 4)
    b = min(bevel, 0.45 * local[2])
    inset = np.concatenate([b * (1.0 - np.sin(t)), b * (1.0 - np.sin(t[::-1]))])
    level = np.concatenate([-local[2] / 2.0 + b * (1.0 - np.cos(t)), local[2] / 2.0 - b * (1.0 - np.cos(t[::-1]))])
    corner = max(corner, 1.2 * b)
    rings = [rounded_rectangle(local[0] - 2.0 * i, local[1] - 2.0 * i, corner - i, steps) for i in inset]
    flat = np.stack(rings)
    high = np.broadcast_to(level[:, None, None], (*flat.shape[:2], 1))
    return loft(np.concatenate([flat, high], axis=-1)[..., order])
