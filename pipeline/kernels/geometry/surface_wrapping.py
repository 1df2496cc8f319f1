"""One closed mesh around a surface that may be crumpled, open or cross itself; smoothing, and refinement, of closed meshes.

Vertices are (V, 3) float64, finite; faces (F, 3) integers, F at least 1.
"""

import igl
import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Integers, Mask
from pipeline.kernels.geometry.level_set import level_set_mesh
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products, mesh_edges, without_slivers
from pipeline.kernels.geometry.signed_distance import is_inside
from pipeline.kernels.geometry.transforms import unit_vectors

REMAINING_SHARE = 0.2  # of the distance to the surface after the wrap is moved onto it: touching sheets stay two sides
SHRINK, GROW = 0.5, 0.505  # Taubin's factors: short bumps go, the volume stays (Fair Surface Design, 1995)


def wrap_surface(vertices: Array, faces: Integers, spacing: float) -> tuple[Array, Integers]:
    """Wrap any set of triangles in one closed mesh, normals outwards, with edges about as long as `spacing`.

    Narrower features and tunnels are lost. Gaps up to twice the spacing are closed exactly, wider holes where the winding number passes
    one half. Of the result, the largest part is kept; parts inside it or apart from it are dropped.

    The level set of the distance at `spacing`, without what is enclosed, is closed and has a body wherever there are triangles, however
    thin. Its vertices are then moved to the nearest points of the triangles, but for a fifth of their distance. Open sheets behind each
    other, wound alike, enclose what is between them and as much before them.
    """
    check_coordinates(vertices, "vertices")
    vertices, faces = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64)
    triangles = without_slivers(vertices, faces)

    def distance(points: Array) -> Array:
        """Compute the signed distance from the shell around the triangles, negative in the shell and inside it."""
        distances: Array = np.sqrt(igl.point_mesh_squared_distance(points, vertices, triangles)[0]) - spacing
        if (off_shell := distances > 0).any():
            distances[off_shell] = np.where(is_inside(points[off_shell], vertices, faces), -distances[off_shell], distances[off_shell])
        return distances

    margin = 2 * spacing
    used = vertices[np.unique(faces)]
    shell, sides = largest_part(*level_set_mesh(distance, used.min(axis=0) - margin, used.max(axis=0) + margin, spacing))
    squared, _, nearest = igl.point_mesh_squared_distance(shell, vertices, triangles)
    on_surface = squared < (1.5 * spacing) ** 2  # the others close a hole
    shell[on_surface] = nearest[on_surface] + REMAINING_SHARE * (shell - nearest)[on_surface]
    return shell, sides


def largest_part(vertices: Array, faces: Integers) -> tuple[Array, Integers]:
    """Keep the part of a closed mesh with the greatest volume, and its vertices."""
    label = igl.facet_components(np.ascontiguousarray(faces))[1]
    volumes = np.bincount(label, weights=np.linalg.det(vertices[faces]))
    used, renamed = np.unique(faces[label == np.argmax(volumes)], return_inverse=True)
    return vertices[used], renamed.reshape(-1, 3)


def smooth_mesh(vertices: Array, faces: Integers, rounds: int) -> Array:  # (V, 3)
    """Smooth a mesh by Taubin's filter: rounds of a shrinking and a growing step."""
    neighbours = neighbour_means(faces, len(vertices))
    for _ in range(rounds):
        for share in (SHRINK, -GROW):
            vertices = vertices + share * (neighbours @ vertices - vertices)
    return vertices


def neighbour_means(faces: Integers, count: int) -> "scipy.sparse.csr_array":
    """Make the (V, V) matrix that replaces each vertex by the mean of its neighbours; a vertex without a face stays."""
    first, second = mesh_edges(faces)[0].T
    isolated = np.setdiff1d(np.arange(count), [first, second])
    rows, columns = np.concatenate([first, second, isolated]), np.concatenate([second, first, isolated])
    degree = np.bincount(rows, minlength=count)
    return scipy.sparse.csr_array((1 / degree[rows], (rows, columns)), shape=(count, count))


def vertex_normals(vertices: Array, faces: Integers) -> Array:
    """Compute the unit normal at each vertex, from its faces by their areas; 0 where they have none."""
    across = face_cross_products(vertices[faces])
    total: Array = np.stack([np.bincount(faces.ravel(), np.repeat(axis, 3), minlength=len(vertices)) for axis in across.T], axis=1)
    return unit_vectors(total)


def split_edges(vertices: Array, faces: Integers, chosen: Mask) -> tuple[Array, Integers]:
    """Split chosen edges (E,) of `mesh_edges` in their middles, which are appended to the vertices, and the faces beside them."""
    ends, edge = mesh_edges(faces)
    middle = np.where(chosen, len(vertices) + np.cumsum(chosen) - 1, -1)
    vertices = np.concatenate([vertices, vertices[ends[chosen]].mean(axis=1)])
    split = chosen[edge]  # (F, 3)
    number = split.sum(axis=1)
    new_faces = [faces[number == 0]]
    for count, table in SPLITS.items():
        selected = number == count
        first = np.argmax(split[selected], axis=1) if count == 1 else (np.argmin(split[selected], axis=1) + 1) % 3  # its first split side
        turned = (first[:, None] + np.arange(3)) % 3
        corners = np.take_along_axis(faces[selected], turned, axis=1)
        middles = np.take_along_axis(middle[edge[selected]], turned, axis=1)
        new_faces.append(np.concatenate([corners, middles], axis=1)[:, table].reshape(-1, 3))
    return vertices, np.concatenate(new_faces)


SPLITS = {
    1: [[0, 3, 2], [3, 1, 2]],
    2: [[3, 1, 4], [0, 3, 4], [0, 4, 2]],
    3: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
}
"""The faces that replace a face, by its number of split sides: corners are 0, 1, 2, the middles of the sides after them 3, 4, 5."""
