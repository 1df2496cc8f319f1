"""Triangle meshes as plain arrays: geometry, look, areas, and points drawn from their surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Floats, Indices, Integers

FARTHEST = 1e18  # largest coordinate that kernels take, any unit: its square fits into float32 too
SLIVER_FLATNESS = 3e-6  # of a face that is replaced by its longest edge, off by as much: libigl's distance would err more
SMALLEST = 1e-100  # coordinates that are all smaller, and not 0, are refused: their products vanish in float64


def check_coordinates(points: Floats, name: str) -> None:  # name: of the points in messages, in the plural
    """Refuse points (N, 3), any unit, that are NaN, beyond `FARTHEST` along an axis, or all nearer to the origin than `SMALLEST`."""
    if not points.size:
        return
    largest = max(-points.min(), points.max())  # NaN where there is one
    if 0 < largest < SMALLEST:
        raise InvalidInput(f"all {name} are less than {SMALLEST:g} from the origin; scale the mesh")
    if not largest <= FARTHEST:
        count = np.count_nonzero(~(np.abs(points) <= FARTHEST).all(axis=1))
        fault = f"NaN, infinite or more than {FARTHEST:g} from the origin"
        raise InvalidInput(f"{count} of {len(points)} {name} are {fault}; repair the mesh or leave them out")


def directed_edges(faces: Integers) -> Integers:
    """List the edges of (F, 3) faces in the direction of each face: (3 F, 2) vertices."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def mesh_edges(faces: Integers) -> tuple[Integers, Integers]:
    """List the edges of a mesh: (E, 2) their ends, and (F, 3) the edge after each corner of each face."""
    following = np.roll(faces, -1, axis=1)
    count = np.int64(faces.max()) + 1  # with which int32 faces do not overflow
    unique, edge = np.unique(np.minimum(faces, following) * count + np.maximum(faces, following), return_inverse=True)
    return np.stack(np.divmod(unique, count), axis=1), edge.reshape(-1, 3)


def is_watertight(faces: Integers) -> bool:
    """Whether each edge of (F, 3) faces is shared by exactly two of them."""
    edges = np.sort(directed_edges(faces).astype(np.int64), axis=1)
    _, counts = np.unique(edges[:, 0] << 32 | edges[:, 1], return_counts=True)
    return bool((counts == 2).all())


@dataclass(frozen=True)
class Look:
    """The look of a mesh: one material per face, each with a base colour and perhaps a texture. Colours are sRGB and opacity."""

    uv: Array32  # (V, 2) texture coordinates of every vertex, v upwards; zeros where no material has a texture
    face_material: NDArray[np.int32]  # (F,) row of `base_color` that paints each face
    base_color: NDArray[np.uint8]  # (M, 4) of every material; it multiplies the texture where there is one
    material_texture: NDArray[np.int32]  # (M,) index in `textures` of each material's texture, -1 for none
    textures: tuple[NDArray[np.uint8], ...] = ()  # (height, width, 4) each, first row at the top
    vertex_color: NDArray[np.uint8] | None = None  # (V, 4) linear in between, multiplies the base colour; None for white

    @staticmethod
    def plain(vertices: int, faces: int, color: tuple[int, int, int] = (178, 178, 178)) -> "Look":
        """Make the look of a mesh of some numbers of vertices and faces in one opaque colour, sRGB."""
        return Look(
            uv=np.zeros((vertices, 2), np.float32),
            face_material=np.zeros(faces, np.int32),
            base_color=np.array([[*color, 255]], np.uint8),
            material_texture=np.array([-1], np.int32),
        )


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh."""

    vertices: Array  # (V, 3) m
    faces: NDArray[np.int32]  # (F, 3)
    look: Look
    unread: tuple[str, ...] = ()  # what its file holds and the mesh lacks, with the reason: "red.png is missing …"

    @staticmethod
    def bare(vertices: np.ndarray, faces: np.ndarray) -> "Mesh":
        """Make a mesh of vertices (V, 3), m, and faces (F, 3) in plain grey."""
        look = Look.plain(len(vertices), len(faces))
        return Mesh(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32), look)

    @property
    def triangles(self) -> Array:
        """(F, 3, 3) corner positions of every face, m."""
        return self.vertices[self.faces]


def face_cross_products(triangles: Array) -> Array:  # to 4 units in the last place of the product of two edges' lengths
    """Compute the cross products (F, 3) of two edges of faces (F, 3, 3): along the winding normal, twice the face's area long."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def flatness(triangles: Array) -> Array:
    """Compute the height of every face (F, 3, 3) over its longest edge, (F,): 0.87 for equal sides, 0 for no area, at any scale."""
    edges = triangles - np.roll(triangles, 1, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    edges = edges / np.where(longest > 0, longest, 1)[:, None, None]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1], edges[:, 2]), axis=1))


def without_slivers(vertices: Array, faces: Integers) -> Integers:
    """Replace faces (F, 3) flatter than `SLIVER_FLATNESS` by their longest edges, named by one vertex twice, for libigl's distances."""
    sliver = np.flatnonzero(flatness(vertices[faces]) < SLIVER_FLATNESS)
    corners = vertices[faces[sliver]]
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)  # each corner's opposite edge
    middle = opposite.argmax(axis=1)
    edges = faces.copy()
    edges[sliver, middle] = faces[sliver, (middle + 1) % 3]
    return edges


def sample_triangles(triangles: Array, count: int, rng: np.random.Generator) -> tuple[Array, Indices]:  # (count, 3), (count,)
    """Draw points area-uniformly from triangles (F, 3, 3), and tell the triangle of each: never one without area.

    A point is on its triangle to within 8 units in the last place of the largest coordinate. A face is drawn with its share of the area,
    then a point in it by folding the unit square over its diagonal (Osada et al., Shape Distributions, 2002, with the fold in place of
    their square root).
    """
    check_coordinates(triangles.reshape(-1, 3), "corners of faces")
    cumulative = np.cumsum(np.linalg.norm(face_cross_products(triangles), axis=1))
    if not (len(cumulative) and cumulative[-1] > 0):
        raise InvalidInput(f"none of the {len(triangles)} triangles has an area to draw points from")
    # random() is at most 1 - 2^-53, and no normal number times that rounds to itself: the end is never reached
    face = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
    u, v = rng.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u)[:, None], np.where(fold, 1 - v, v)[:, None]
    corner = triangles[face]
    points = corner[:, 0] + u * (corner[:, 1] - corner[:, 0]) + v * (corner[:, 2] - corner[:, 0])
    return points, face
