"""The closed sphere of vision charts, and which of their vertices coincide (supplement 3.1, Figure 4).

The sphere is a tetrakis hexahedron (a cube with a pyramid on each side: 24 triangles), each triangle split into four `splits` times
and bulged onto the unit sphere. Each triangle is one chart, which keeps its own vertices: twelve along the boundary, a ring of six inside
them, and the centre. Corners and sides shared by charts are known by their numbers, so coordinates are never compared; coinciding
vertices are copies of one position, equal to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

BOUNDARY, RING = 12, 6
CHART_VERTICES = BOUNDARY + RING + 1
"""Vertices of a chart, in this order: the boundary from the first corner on (corners are 0, 4, 8), the ring, the centre."""
CENTRE = CHART_VERTICES - 1
MOST_SPLITS = 4
"""6144 charts: more would be finer than any image resolves."""

Triangles = list[tuple[int, int, int]]
Array = TypeVar("Array", bound=NDArray[Any])


@dataclass(frozen=True, eq=False)
class VisionCharts:
    """C vision charts that close a sphere, V = 19 C vertices, F = 24 C faces, P distinct positions; arrays are read-only.

    Attributes
    ----------
    vertices
        (V, 3) float64 on the unit sphere. Chart c's are 19 c to 19 c + 18.
    faces
        (F, 3) int64, wound so that normals point outwards.
    chart
        (V,) int64, the chart of each vertex.
    centres
        (C,) int64, the vertex in the middle of each chart.
    position
        (V,) int64 in 0..P-1, which distinct position each vertex has.
    seams
        (S, 2) int64, each pair i < j of vertices that coincide, in ascending order.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    chart: NDArray[np.int64]
    centres: NDArray[np.int64]
    position: NDArray[np.int64]
    seams: NDArray[np.int64]


@lru_cache(maxsize=8)
def vision_charts(splits: int = 1) -> VisionCharts:
    """Make the 24 · 4^splits vision charts around the unit sphere.

    Parameters
    ----------
    splits
        Times that each triangle of the tetrakis hexahedron is split into four, 0 to 4. One, the supplement's number, gives 96 charts,
        1824 vertices, 2304 faces and 1154 distinct positions.

    Returns
    -------
    The charts, in radii of the sphere; kept in memory and shared by all callers.

    Raises
    ------
    ValueError
        `splits` is not in 0..4.
    """
    if not 0 <= splits <= MOST_SPLITS:
        raise ValueError(f"splits is {splits}, but a sphere of charts can be split 0 to {MOST_SPLITS} times")
    corners, triangles = tetrakis_hexahedron()
    for _ in range(splits):
        corners, triangles = _split(corners, triangles)
    points = list(corners)
    sides: dict[tuple[int, int], tuple[int, int, int]] = {}
    position = np.array([_positions(triangle, points, sides) for triangle in triangles], np.int64)  # (C, 19)
    charts = np.arange(len(triangles), dtype=np.int64)
    faces = _chart_faces()[None] + CHART_VERTICES * charts[:, None, None]  # (C, 24, 3)
    return VisionCharts(
        vertices=_frozen(np.array(points)[position.ravel()]),
        faces=_frozen(faces.reshape(-1, 3)),
        chart=_frozen(np.repeat(charts, CHART_VERTICES)),
        centres=_frozen(CENTRE + CHART_VERTICES * charts),
        position=_frozen(position.ravel()),
        seams=_frozen(_coinciding(position.ravel())),
    )


def tetrakis_hexahedron() -> tuple[list[NDArray[np.float64]], Triangles]:
    """Make a tetrakis hexahedron: a cube with a pyramid on each side.

    Returns
    -------
    vertices
        14 points (3,) float64 on the unit sphere: the cube's corners, then the middles of its sides.
    triangles
        24 triples of vertex numbers, wound outwards.
    """
    cube = [np.array(corner) for corner in product((-1, 1), repeat=3)]
    middles = [sign * np.eye(3, dtype=int)[axis] for axis in range(3) for sign in (-1, 1)]
    keys = cube + middles
    triangles: Triangles = []
    for apex, middle in enumerate(middles, start=len(cube)):
        for a, b in combinations(range(len(cube)), 2):
            is_edge = np.abs(cube[a] - cube[b]).sum() == 2
            if is_edge and cube[a] @ middle == 1 and cube[b] @ middle == 1:
                outward = np.dot(middle, np.cross(cube[a], cube[b])) > 0  # integers: exact
                triangles.append((apex, a, b) if outward else (apex, b, a))
    return [_on_sphere(key.astype(np.float64)) for key in keys], triangles


def _on_sphere(point: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(point / np.linalg.norm(point), np.float64)


def _split(corners: list[NDArray[np.float64]], triangles: Triangles) -> tuple[list[NDArray[np.float64]], Triangles]:
    """Each triangle into four, at the middles of its sides; a side shared by two triangles has one middle."""
    points = list(corners)
    middles: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(points)
            points.append(_on_sphere(points[a] + points[b]))
        return middles[key]

    smaller: Triangles = []
    for a, b, c in triangles:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        smaller += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return points, smaller


def _positions(
    triangle: tuple[int, int, int], points: list[NDArray[np.float64]], sides: dict[tuple[int, int], tuple[int, int, int]]
) -> list[int]:
    """(19,) position numbers of a chart; `points` and `sides` (the three positions along each side, by its ends) grow as needed."""

    def add(point: NDArray[np.float64]) -> int:
        points.append(_on_sphere(point))
        return len(points) - 1

    def along(a: int, b: int) -> tuple[int, int, int]:
        low, high = min(a, b), max(a, b)
        if (low, high) not in sides:
            half = add(points[low] + points[high])
            sides[low, high] = add(points[low] + points[half]), half, add(points[half] + points[high])
        quarter, half, three_quarters = sides[low, high]
        return (quarter, half, three_quarters) if a == low else (three_quarters, half, quarter)

    a, b, c = triangle
    boundary = [a, *along(a, b), b, *along(b, c), c, *along(c, a)]
    centre = _on_sphere(points[a] + points[b] + points[c])
    # Halfway from the centre to every other boundary vertex, all 24 faces of a flat chart have the same area.
    ring = [add(centre + points[outer]) for outer in boundary[::2]]
    return [*boundary, *ring, add(centre)]


def _chart_faces() -> NDArray[np.int64]:
    """(24, 3) faces of one chart, wound like its boundary."""
    faces = []
    for k in range(RING):
        corner, between, following = 2 * k, 2 * k + 1, (2 * k + 2) % BOUNDARY
        inner, inner_following = BOUNDARY + k, BOUNDARY + (k + 1) % RING
        faces += [
            (corner, between, inner),
            (between, inner_following, inner),
            (between, following, inner_following),
            (inner, inner_following, CENTRE),
        ]
    return np.array(faces, np.int64)


def _coinciding(position: NDArray[np.int64]) -> NDArray[np.int64]:
    """(S, 2) each pair i < j of vertices with the same position number."""
    order = np.argsort(position, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(position[order])) + 1)
    return np.array(sorted(pair for group in groups for pair in combinations(group.tolist(), 2)), np.int64)


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array
