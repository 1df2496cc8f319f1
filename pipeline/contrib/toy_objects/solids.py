"""Closed solids, lofted from cross-sections: the vocabulary of all procedural objects.

Lengths are millimetres, z is up. Every solid is one closed, outward-wound manifold.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Rows = Sequence[Sequence[Any]] | Array
Color = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Material:
    """One base colour, perhaps a texture image that it multiplies."""

    color: Color  # sRGB
    image: NDArray[np.uint8] | None = None  # (height, width, 4)


@dataclass(frozen=True)
class Solid:
    """One closed part of an object."""

    vertices: Array  # (V, 3) mm
    faces: NDArray[np.int32]  # (F, 3) corners, wound outwards
    uv: Array  # (V, 2) texture coordinates, v upwards
    layer: NDArray[np.int32]  # (F,) 0 for the part's own material, i for the i-th painted over it
    paints: tuple[Material, ...] = ()  # the materials painted over it

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        """Return the solid shifted."""
        return replace(self, vertices=self.vertices + [x, y, z])

    def turned(self, axis: str, angle: float, about: Sequence[float] = (0.0, 0.0, 0.0)) -> "Solid":
        """Return the solid rotated by `angle` (rad, right-handed) about the line along `axis` through `about`."""
        return replace(self, vertices=scipy.spatial.transform.Rotation.from_euler(axis, angle).apply(self.vertices - about) + about)

    def painted(self, material: Material, faces: NDArray[np.bool_], uv: Array | None = None) -> "Solid":
        """Return the solid with a material over some faces (F,), and with new texture coordinates (V, 2) if given."""
        layer = np.where(faces, len(self.paints) + 1, self.layer).astype(np.int32)
        return replace(self, layer=layer, paints=(*self.paints, material), uv=self.uv if uv is None else uv)


def loft(rings: Array) -> Solid:
    """Skin over (S, N, 3) cross-sections, closed by a fan at either end.

    Each is star-shaped about its mean, and runs counter-clockwise where the next one lies towards the viewer.
    """
    count, around = rings.shape[:2]
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    near = np.arange(count * around).reshape(count, around)
    side = np.roll(near, -1, axis=1)
    bottom, top = np.full((2, around), [[count * around], [count * around + 1]])
    triangles = [(near[:-1], side[:-1], side[1:]), (near[:-1], side[1:], near[1:]), (bottom, side[0], near[0]), (top, near[-1], side[-1])]
    faces = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in triangles]).astype(np.int32)
    return Solid(vertices, faces, np.zeros((len(vertices), 2)), np.zeros(len(faces), np.int32))


def superellipse(half_u: ArrayLike, half_v: ArrayLike, exponent: ArrayLike, count: int) -> Array:  # (S, count, 2)
    """Compute points of |u/half_u|^n + |v/half_v|^n = 1, from +v on: an ellipse for n = 2, nearly a rectangle for 8."""
    angle = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    circle = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    halves = np.stack(np.broadcast_arrays(half_u, half_v), axis=-1).reshape(-1, 1, 2)
    return np.asarray(halves * np.sign(circle) * np.abs(circle) ** (2.0 / np.reshape(exponent, (-1, 1, 1))))


def column(
    rows: Rows,
    axis: str = "z",
    count: int = 32,  # points of a cross-section
    *,
    centre: ArrayLike = 0.0,  # middle of the cross-sections along v: one number, or one per row
    lobes: int = 0,  # ripples around
    depth: ArrayLike = 0.0,  # of the ripples, relative: one number, or one per row
) -> Solid:
    """Loft along an axis, one cross-section per row.

    A row is (position, radius), or (position, half u, half v, exponent) of a superellipse; u and v are the next two
    axes in cyclic order.
    """
    position, half_u, *rest = np.asarray(rows, float).T
    half_v, exponent = rest or (half_u, 2.0)
    ripples = np.cos(lobes * (np.arange(count) + 0.5) * (2.0 * np.pi / count))
    flat = superellipse(half_u, half_v, exponent, count) * (1.0 + np.reshape(depth, (-1, 1)) * ripples)[..., None]
    u, v, along = flat[..., 0], flat[..., 1] + np.reshape(centre, (-1, 1)), np.broadcast_to(position[:, None], flat.shape[:2])
    return loft(np.roll(np.stack([u, v, along], axis=-1), "xyz".index(axis) + 1, axis=-1))


def lathe(rows: Rows, axis: str = "z", count: int = 32) -> Solid:
    """Loft smoothly along an axis through rows, as `column` takes them."""
    return column(smooth(rows), axis, count)


def bar(rows: Rows, exponent: float = 3.4, trim: Material | None = None, spans: Sequence[Sequence[float]] = ()) -> Solid:
    """Loft smoothly along x: rows (x, bottom z, top z, width along y); another material over spans (low, high) of x."""
    x, low, high, width = smooth(rows, at=np.ravel(spans)).T
    table = np.column_stack([x, width / 2.0, (high - low) / 2.0, np.full(len(x), exponent)])
    solid = column(table, "x", 24, centre=(low + high) / 2.0)
    if trim is None:
        return solid
    middle = solid.vertices[solid.faces, 0].mean(axis=1)
    return solid.painted(trim, np.any([(middle > start - 1e-6) & (middle < end + 1e-6) for start, end in spans], axis=0))


def block(x: tuple[float, float], z: tuple[float, float], width: float) -> Solid:
    """Make an upright block over ranges of x and z, its long edges rounded."""
    return column([(at, width / 2.0, (z[1] - z[0]) / 2.0, 9) for at in x], "x", 16, centre=sum(z) / 2.0)


def vessel(
    rows: Rows,  # its outside, from the foot to the rim, as `column` takes them; refined smoothly
    wall: float,  # thickness
    floor: float,  # height above which the vessel is hollow
    inside: Material | None = None,  # if that is another one
    bands: Sequence[tuple[float, float, Material]] = (),  # around its outside: lowest z, highest z, material
) -> Solid:
    """Loft a vessel that is open at the top."""
    ends = np.clip([band[:2] for band in bands], rows[0][0], rows[-1][0])  # a band up to the rim may state more
    count, outer = 40, smooth(rows, at=[floor, *np.ravel(ends)])
    hollow = outer[outer[:, 0] > floor - 1e-6][::-1].copy()
    hollow[:, 1:3] -= wall  # half u, and half v where there is one: exponents are further right
    solid = column(np.concatenate([outer, hollow]), count=count)
    within, z = solid.faces.min(axis=1) >= len(outer) * count, solid.vertices[solid.faces, 2].mean(axis=1)
    for low, high, material in bands:
        solid = solid.painted(material, ~within & (z > low) & (z < high))
    return solid if inside is None else solid.painted(inside, within)


def rod(start: float, end: float, radius: float, axis: str = "x") -> Solid:
    """Make a round bar along an axis."""
    return column([(start, radius), (end, radius)], axis, 20)


def ball(radii: Sequence[float]) -> Solid:
    """Make an ellipsoid about the origin."""
    angle = np.linspace(0.0, np.pi, 9)[1:-1]
    solid = column(np.column_stack([-np.cos(angle), np.sin(angle)]), count=14)
    return replace(solid, vertices=solid.vertices * radii)


def box(size: Sequence[float] | Array, exponent: float = 8.0, bevel: float = 1.0, axis: str = "y", count: int = 24) -> Solid:
    """Make a box of `size` (x, y, z) about the origin: outline across `axis` a superellipse, the edges of its two ends rounded."""
    u, v, along = np.roll(size, 2 - "xyz".index(axis)) / 2.0
    edge = [(along - bevel * down, bevel * inset) for down, inset in ((1.0, 0.0), (0.3, 0.3), (0.0, 1.0))]
    rows = [(at, u - inset, v - inset, exponent) for at, inset in (*((-at, inset) for at, inset in edge[::-1]), *edge)]
    return column(rows, axis, count)


def tube(line: Array, lateral: Array, flat: Array) -> Solid:  # (N, 3), (3,) or (N, 3), (1, K, 2) along `lateral` and across
    """Loft one cross-section along a line."""
    up = np.cross(np.gradient(line, axis=0), lateral)
    up /= np.sqrt((up * up).sum(axis=1, keepdims=True))
    return loft(line[:, None] + flat[..., :1] * np.expand_dims(lateral, -2) + flat[..., 1:] * up[:, None])


def sweep(points: Rows, width: float, height: float, exponent: float = 3.0) -> Solid:
    """Loft along a smooth curve through points (N, 3): `width` along the axis in which it extends least, `height` across."""
    knots = np.array(points, float)
    length = np.cumsum([0.0, *np.sqrt((np.diff(knots, axis=0) ** 2).sum(axis=1))])
    line = scipy.interpolate.PchipInterpolator(length, knots)(np.linspace(0.0, length[-1], 5 * len(knots)))
    return tube(line, np.eye(3)[np.ptp(line, axis=0).argmin()], superellipse(width / 2.0, height / 2.0, exponent, 16))


def bow(
    half: Sequence[tuple[float, float]],  # (x, z) from the end at +x to the middle
    width: float,
    height: float,
) -> Solid:
    """Sweep an arch over the plane x = 0, its left half mirrored."""
    left, right = [(-x, 0.0, z) for x, z in half], [(x, 0.0, z) for x, z in half[::-1] if x]
    return sweep([*left, *right], width, height)


def coil(rows: Rows, turns: float, axis: str = "z") -> Solid:
    """Wind a wire around an axis, rising evenly: rows (position, radius of the turn, radius of the wire)."""
    table, share = np.asarray(rows, float), np.linspace(0.0, 1.0, int(32 * turns))
    position, radius, thick = (np.interp(share, np.linspace(0.0, 1.0, len(table)), column) for column in table.T)
    angle = 2.0 * np.pi * turns * share
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    line = radius[:, None] * outward + position[:, None] * [0.0, 0.0, 1.0]
    solid = tube(line, outward, superellipse(thick, thick, 2.0, 12)[..., ::-1] * [1.0, -1.0])
    return replace(solid, vertices=np.roll(solid.vertices, "xyz".index(axis) + 1, axis=-1))


def smooth(rows: Rows, between: int = 4, at: ArrayLike = ()) -> Array:
    """Refine a table whose first column rises by monotone cubics: `between` steps per row, and a row at each value of `at`."""
    table = np.asarray(rows, float)
    steps = np.interp(np.arange((len(table) - 1) * between + 1) / between, np.arange(len(table)), table[:, 0])
    inserted = np.ravel(at)
    positions = np.sort([*inserted, *(step for step in steps if (np.abs(inserted - step) > 0.5).all())])  # no slivers
    return np.column_stack([positions, scipy.interpolate.PchipInterpolator(table[:, 0], table[:, 1:])(positions)])
