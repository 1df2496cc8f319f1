"""The closed sphere of vision charts, and which of their vertices coincide (supplement 3.1, Figure 4).

The sphere is a tetrakis hexahedron (a cube with a pyramid on each side: 24 triangles), each triangle split into four `splits` times and
bulged onto the unit sphere. Each triangle is one chart, which keeps its own vertices: twelve along the boundary, a ring of six inside them,
and the centre. Corners and sides shared by charts are known by their numbers: coinciding vertices are equal to the bit.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh_cleaning import group_by_position

BOUNDARY, RING = 12, 6
CHART_VERTICES = BOUNDARY + RING + 1  # in this order: the boundary from the first corner on (corners are 0, 4, 8), the ring, the centre
CENTRE = CHART_VERTICES - 1
MAX_SPLITS = 4  # 6144 charts: more would be finer than any image resolves

Triangle = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class VisionCharts:
    """C vision charts that close a sphere, V = 19 C vertices, F = 24 C faces, P positions; arrays are read-only."""

    vertices: Array  # (V, 3) on the unit sphere; chart c's are 19 c to 19 c + 18
    faces: NDArray[np.int64]  # (F, 3) wound so that normals point outwards
    centres: NDArray[np.int64]  # (C,) vertex in the middle of each chart
    position: NDArray[np.int64]  # (V,) in 0..P-1, which distinct position each vertex has
    seams: NDArray[np.int64]  # (S, 2) each pair i < j of vertices that coincide, in ascending order

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.flags.writeable = False


@lru_cache(maxsize=8)
def vision_charts(splits: int = 1) -> VisionCharts:  # kept in memory and shared by all callers
    """Make the 24 · 4^splits vision charts around the unit sphere; one split gives the supplement's 96 charts of 1824 vertices."""
    sphere, triangles = _tetrakis_hexahedron()
    for _ in range(splits):
        triangles = [smaller for triangle in triangles for smaller in _split(triangle, sphere)]
    position = np.array([_chart_positions(triangle, sphere) for triangle in triangles], np.int64)  # (C, 19)
    first = CHART_VERTICES * np.arange(len(triangles), dtype=np.int64)  # (C,)
    shared = group_by_position(position.ravel())
    return VisionCharts(
        vertices=np.array(sphere.points)[position.ravel()],
        faces=(_chart_faces() + first[:, None, None]).reshape(-1, 3),
        centres=first + CENTRE,
        position=position.ravel(),
        seams=np.array(sorted(pair for group in shared for pair in combinations(group.tolist(), 2)), np.int64),
    )


@dataclass(frozen=True, eq=False)
class _SpherePoints:
    """Numbered points on the unit sphere; each is made at its first use."""

    points: list[Array] = field(default_factory=list)
    middles: dict[frozenset[int], int] = field(default_factory=dict)

    def add(self, point: Array) -> int:
        """Add a point, moved onto the sphere, and return its number."""
        self.points.append(_on_sphere(point))
        return len(self.points) - 1

    def middle(self, a: int, b: int) -> int:
        """Return the point halfway between two: the same from either end."""
        ends = frozenset((a, b))
        if ends not in self.middles:
            self.middles[ends] = self.add(self.points[a] + self.points[b])
        return self.middles[ends]

    def quarters(self, a: int, b: int) -> list[int]:
        """Return the three points that divide the arc from a to b into four."""
        half = self.middle(a, b)
        low, high = (self.middle(end, half) for end in sorted((a, b)))
        return [low, half, high] if a < b else [high, half, low]


def _on_sphere(point: Array) -> Array:
    return np.asarray(point / np.linalg.norm(point), np.float64)


def _tetrakis_hexahedron() -> tuple[_SpherePoints, list[Triangle]]:
    """Make 14 points, a cube's corners and the middles of its sides, and 24 triangles of them, wound outwards."""
    cube, sphere, triangles = np.array(list(product((-1, 1), repeat=3))), _SpherePoints(), []
    for corner in cube:
        sphere.add(corner)
    for middle in (sign * axis for axis in np.eye(3, dtype=int) for sign in (-1, 1)):
        apex = sphere.add(middle)
        for a, b in combinations(np.flatnonzero(cube @ middle == 1).tolist(), 2):
            if np.abs(cube[a] - cube[b]).sum() == 2:  # an edge of the cube, no diagonal
                outward = middle @ np.cross(cube[a], cube[b]) > 0  # integers: exact
                triangles.append((apex, a, b) if outward else (apex, b, a))
    return sphere, triangles


def _split(triangle: Triangle, sphere: _SpherePoints) -> list[Triangle]:
    a, b, c = triangle
    ab, bc, ca = sphere.middle(a, b), sphere.middle(b, c), sphere.middle(c, a)
    return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]


def _chart_positions(triangle: Triangle, sphere: _SpherePoints) -> list[int]:
    a, b, c = triangle
    boundary = [a, *sphere.quarters(a, b), b, *sphere.quarters(b, c), c, *sphere.quarters(c, a)]
    centre = _on_sphere(sphere.points[a] + sphere.points[b] + sphere.points[c])
    # Halfway from the centre to every other boundary vertex, all 24 faces of a flat chart have the same area.
    ring = [sphere.add(centre + sphere.points[outer]) for outer in boundary[::2]]
    return [*boundary, *ring, sphere.add(centre)]


def _chart_faces() -> NDArray[np.int64]:
    """List the faces (24, 3) of one chart, wound like its boundary."""
    faces = []
    for k in range(RING):
        corner, between, following = 2 * k, 2 * k + 1, (2 * k + 2) % BOUNDARY
        inner, next_inner = BOUNDARY + k, BOUNDARY + (k + 1) % RING
        faces += [(corner, between, inner), (between, next_inner, inner), (between, following, next_inner), (inner, next_inner, CENTRE)]
    return np.array(faces, np.int64)
