"""Closed solids, lofted from cross-sections: the vocabulary of all procedural objects.

Lengths are millimetres, z is up. Every solid is one closed, outward-wound manifold.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
Rows = Sequence[Sequence[float]] | Array
AXES = {"x": 0, "y": 1, "z": 2}
AXIS_ORDER = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}  # of (u, v, along); cyclic, so that handedness stays


@dataclass(frozen=True)
class Solid:
    """One closed part of an object.

    Attributes
    ----------
    vertices
        (V, 3) positions, mm.
    faces
        (F, 3) int32 corners, wound outwards.
    uv
        (V, 2) texture coordinates in [0, 1], v upwards.
    layer
        (F,) int32, the number of each face's material among those of the part.
    """

    vertices: Array
    faces: NDArray[np.int32]
    uv: Array
    layer: NDArray[np.int32]

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        """Return the solid shifted."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def turned(self, axis: str, angle: float, about: Sequence[float] = (0.0, 0.0, 0.0)) -> Solid:
        """Return the solid rotated by `angle` (rad, right-handed) about the line along `axis` through `about`."""
        offset, cosine, sine = self.vertices - np.array(about), np.cos(angle), np.sin(angle)
        j, k = (AXES[axis] + 1) % 3, (AXES[axis] + 2) % 3
        offset[:, j], offset[:, k] = cosine * offset[:, j] - sine * offset[:, k], sine * offset[:, j] + cosine * offset[:, k]
        return replace(self, vertices=offset + np.array(about))

    def painted(self, where: NDArray[np.bool_], uv: Array | None = None) -> Solid:
        """Return the solid with one more layer: the faces whose vertices are all in `where` (V,), with their `uv` (V, 2)."""
        layer = np.where(where[self.faces].all(axis=1), self.layer.max() + 1, self.layer).astype(np.int32)
        return replace(self, layer=layer, uv=self.uv if uv is None else np.where(where[:, None], uv, self.uv))

    def banded(self, axis: str, spans: Iterable[Sequence[float]]) -> Solid:
        """Return the solid with one more layer per span (low, high) along an axis; cross-sections must lie at both."""
        solid, along = self, self.vertices[:, AXES[axis]]
        for low, high in spans:
            solid = solid.painted((along > low - 1e-6) & (along < high + 1e-6))
        return solid


def loft(rings: Array) -> Solid:
    """Skin over (S, N, 3) cross-sections, each star-shaped about its mean, closed by a fan at either end."""
    count, around = rings.shape[:2]
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    near = np.arange(count * around, dtype=np.int32).reshape(count, around)
    side = np.roll(near, -1, axis=1)
    bottom, top = np.full((2, around), [[count * around], [count * around + 1]], np.int32)
    a, b, c, d = near[:-1].ravel(), side[:-1].ravel(), side[1:].ravel(), near[1:].ravel()
    triangles = [(a, b, c), (a, c, d), (bottom, side[0], near[0]), (top, near[-1], side[-1])]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in triangles])
    p, q, r = (vertices[faces[:, i]] - vertices[-1] for i in range(3))
    if (p * np.cross(q, r)).sum() < 0.0:  # six times the signed volume
        faces = np.ascontiguousarray(faces[:, ::-1])
    return Solid(vertices, faces, np.zeros((len(vertices), 2)), np.zeros(len(faces), np.int32))


def superellipse(half_u: ArrayLike, half_v: ArrayLike, exponent: ArrayLike, count: int) -> Array:
    """Compute (..., count, 2) points of |u/half_u|^n + |v/half_v|^n = 1: an ellipse for n = 2, nearly a rectangle for 8."""
    angle = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    power = 2.0 / np.asarray(exponent, float)[..., None]
    u, v = (np.sign(w) * np.abs(w) ** power for w in (np.cos(angle), np.sin(angle)))
    return np.stack(np.broadcast_arrays(np.asarray(half_u)[..., None] * u, np.asarray(half_v)[..., None] * v), axis=-1)


def column(rows: Rows, axis: str = "z", count: int = 32, *, centre: ArrayLike = 0.0, lobes: int = 0, depth: ArrayLike = 0.0) -> Solid:
    """Loft along an axis.

    Parameters
    ----------
    rows
        One cross-section each: (position, radius), or (position, half u, half v, exponent) of a superellipse; u and v are
        the next two axes in cyclic order.
    axis, count
        The axis, and the points of a cross-section.
    centre
        The middle of the cross-sections along v, one number or one per row.
    lobes, depth
        Number of ripples around, and their relative depth: one number or one per row.
    """
    table = np.asarray(rows, float)
    if table.shape[1] == 2:
        table = np.column_stack([table[:, [0, 1, 1]], np.full(len(table), 2.0)])
    flat = superellipse(table[:, 1], table[:, 2], table[:, 3], count)
    if lobes:
        wave = np.cos(lobes * (np.arange(count) + 0.5) * (2.0 * np.pi / count))
        flat = flat * (1.0 + np.multiply.outer(np.broadcast_to(depth, len(table)), wave))[..., None]
    u, v, along = flat[..., 0], flat[..., 1] + np.reshape(centre, (-1, 1)), np.broadcast_to(table[:, :1], flat.shape[:2])
    return loft(np.stack([u, v, along], axis=-1)[..., AXIS_ORDER[axis]])


def bar(rows: Rows, exponent: float = 4.0, count: int = 20) -> Solid:
    """Loft along x: rows (x, bottom z, top z, width along y)."""
    x, low, high, width = np.asarray(rows, float).T
    table = np.column_stack([x, width / 2.0, (high - low) / 2.0, np.full(len(x), exponent)])
    return column(table, "x", count, centre=(low + high) / 2.0)


def block(x: tuple[float, float], z: tuple[float, float], width: float) -> Solid:
    """Make an upright block over ranges of x and z, its long edges rounded."""
    return bar([(at, *z, width) for at in x], 9.0, 16)


def rod(start: float, end: float, radius: float, axis: str = "x", bevel: float = 0.12, count: int = 20) -> Solid:
    """Make a round bar along an axis, its ends bevelled by a share of the radius."""
    b = min(bevel * radius, 0.4 * (end - start))
    return column([(start, radius - b), (start + b, radius), (end - b, radius), (end, radius - b)], axis, count)


def ball(radii: Sequence[float], count: int = 14) -> Solid:
    """Make an ellipsoid about the origin."""
    angle = np.linspace(0.0, np.pi, count // 2 + 2)[1:-1]
    solid = column(np.column_stack([-np.cos(angle), np.sin(angle)]), count=count)
    return replace(solid, vertices=solid.vertices * np.array(radii))


def box(size: Sequence[float], exponent: float = 8.0, bevel: float = 1.0, axis: str = "y", count: int = 24) -> Solid:
    """Make a box of `size` (x, y, z) about the origin: outline across `axis` a superellipse, the edges of its two ends rounded."""
    order = AXIS_ORDER[axis]
    u, v, along = (size[order.index(i)] / 2.0 for i in range(3))
    b = min(bevel, 0.9 * along)
    edge = [(-along + b * down, b * inset) for down, inset in ((0.0, 1.0), (0.3, 0.3), (1.0, 0.0))]
    rows = [(at, u - inset, v - inset, exponent) for at, inset in (*edge, *((-at, inset) for at, inset in edge[::-1]))]
    return column(rows, axis, count)


def sweep(path: ArrayLike, width: ArrayLike, height: ArrayLike, exponent: float = 3.0, side: str = "y", count: int = 14) -> Solid:
    """Loft along a path (S, 3) that lies across the axis `side`: `width` along it, `height` across, each a number or (S,)."""
    line, lateral = np.asarray(path, float), np.eye(3)[AXES[side]]
    up = np.cross(np.gradient(line, axis=0), lateral)
    up /= np.sqrt((up * up).sum(axis=1, keepdims=True))
    half_width, half_height = (np.broadcast_to(np.asarray(w, float) / 2.0, len(line)) for w in (width, height))
    flat = superellipse(half_width, half_height, exponent, count)
    return loft(line[:, None] + flat[..., :1] * lateral + flat[..., 1:] * up[:, None])


def smooth(rows: Rows, between: int = 4, at: Sequence[float] = ()) -> Array:
    """Refine a table whose first column rises by monotone cubics: `between` steps per row, and a row at each value of `at`."""
    table = np.asarray(rows, float)
    steps = np.arange((len(table) - 1) * between + 1) / between
    where = np.interp(steps, np.arange(len(table)), table[:, 0])
    wanted = np.array(sorted(at))
    where = np.sort([*wanted, *(w for w in where if (np.abs(wanted - w) > 0.5).all())])  # no slivers
    return np.column_stack([where, PchipInterpolator(table[:, 0], table[:, 1:])(where)])


def curve(points: Rows, count: int = 14) -> Array:
    """Compute (count, 3) points evenly along a smooth curve through `points`, by chord length."""
    knots = np.array(points, float)
    chords = np.diff(knots, axis=0)
    length = np.concatenate([[0.0], np.cumsum(np.sqrt((chords * chords).sum(axis=1)))])
    return np.asarray(PchipInterpolator(length, knots)(np.linspace(0.0, length[-1], count)))
