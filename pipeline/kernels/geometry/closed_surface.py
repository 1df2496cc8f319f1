"""Closed, smooth meshes around surfaces that may be crumpled, open or cross themselves, pulled through touched points.

Vertices are (V, 3) float64, finite; faces (F, 3) integers, F at least 1.
"""

import igl
import numpy as np
import scipy
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Indices, Integers
from pipeline.kernels.geometry.level_set import level_set_mesh
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products, is_watertight, mesh_edges, without_slivers
from pipeline.kernels.geometry.signed_distance import inside_test
from pipeline.kernels.geometry.transforms import unit_vectors

REMAINING_SHARE = 0.2  # of the distance to the surface after the wrap is moved onto it: touching sheets stay two sides
SHRINK, GROW = 0.5, 0.505  # Taubin's factors: short bumps go, the volume stays (Fair Surface Design, 1995)
RESOLUTION = 128  # edges of the mesh along the longest side of the surface's box: 4 mm of an object of half a metre
COARSEST = 64  # fewest edges: with fewer, thin bodies swell and charts distort them
TOLERANCE = 4e-4  # m from touched points to the mesh; half of the promised distance, since files hold float32
INPUT_SMOOTHING_ROUNDS = 4  # rounds of Taubin's filter on the input surface, which flatten bumps as short as its edges
WRAP_SMOOTHING_ROUNDS = 100  # rounds on the closed mesh, which flatten the steps of the grid
ATTACHMENT_ROUNDS = 4  # rounds of assigning a part of the mesh to each point and pulling it there
REFINEMENT = 4  # edges around the points become about this many times shorter
NORMAL_WEIGHT = 2.0  # spacings added to the distance of a face with a normal perpendicular to the point's; opposite, twice
CANDIDATES = 6  # faces, nearest by their middles, among which the nearest face is searched
REACH = 4.0  # distance from the points within which the mesh is moved, in spacings
FALLOFF = 3.0  # a point pulled far moves a larger neighbourhood: this multiple of the distance …
LARGEST_SHARE = 0.25  # … but no more than this share of the mesh's extent
STIFFNESS = 0.3  # weight of bending beside that of the points


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
    triangles, is_inside = without_slivers(vertices, faces), inside_test(vertices, faces)
    tree = igl.AABB()
    tree.init(vertices, triangles)

    def distance(points: Array) -> Array:
        """Compute the signed distance from the shell around the triangles, negative in the shell and inside it."""
        distances: Array = np.sqrt(tree.squared_distance(vertices, triangles, points)[0]) - spacing
        off_shell = np.flatnonzero(distances > 0)
        distances[off_shell[is_inside(points[off_shell])]] *= -1
        return distances

    margin = 2 * spacing
    used = vertices[np.unique(faces)]
    shell, sides = largest_part(*level_set_mesh(distance, used.min(axis=0) - margin, used.max(axis=0) + margin, spacing))
    squared, _, nearest = tree.squared_distance(vertices, triangles, shell)
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


def split_edges(vertices: Array, faces: Integers, ends: Integers, edge: Integers, chosen: Indices) -> tuple[Array, Integers]:
    """Split chosen edges of `mesh_edges` in their middles, which are appended to the vertices, and the faces beside them."""
    middle = np.full(len(ends), -1)
    middle[chosen] = len(vertices) + np.arange(len(chosen))
    vertices = np.concatenate([vertices, vertices[ends[chosen]].mean(axis=1)])
    split = middle[edge] >= 0  # (F, 3)
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


SPLITS = {  # the faces that replace a face, by its number of split sides: corners are 0, 1, 2, the middles of the sides after them 3, 4, 5
    1: [[0, 3, 2], [3, 1, 2]],
    2: [[3, 1, 4], [0, 3, 4], [0, 4, 2]],
    3: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
}


def closed_surface(
    vertices: Array,  # (V, 3) m
    faces: Integers,  # (F, 3); the surface may be crumpled, open, or cross itself
    points: Array,  # (N, 3) touched, m; bulges reach those far from the surface
    normals: Array,  # (N, 3) unit, outwards; 0 where unknown
    *,
    resolution: int = RESOLUTION,  # edges of the mesh along the longest side of the surface's box, `COARSEST` or more
) -> tuple[Array, Integers]:
    """Make one closed, smooth mesh of one part, normals outwards, that passes within 0.5 mm of each touched point."""
    if resolution < COARSEST:
        raise InvalidInput(f"resolution {resolution}: thin parts vanish in so coarse a mesh; give {COARSEST} edges or more")
    used_vertices = vertices[np.unique(faces)]
    if not len(used_vertices) or not np.isfinite(used_vertices).all() or not (extent := float(np.ptp(used_vertices, axis=0).max())) > 0:
        raise InvalidInput(f"a surface of {len(faces)} faces has vertices that are NaN or infinite, or no extent, and cannot be closed")
    spacing = extent / resolution
    if is_watertight(faces):  # else its rims would shrink
        vertices = smooth_mesh(vertices, faces, INPUT_SMOOTHING_ROUNDS)
    closed, sides = wrap_surface(vertices, faces, spacing)
    closed = smooth_mesh(closed, sides, WRAP_SMOOTHING_ROUNDS)
    return attach_points(closed, sides, points, normals, spacing=spacing, tolerance=TOLERANCE)


def attach_points(
    vertices: Array,  # (V, 3)
    faces: Integers,  # (F, 3), closed, normals outwards
    points: Array,  # (N, 3) on the true surface
    normals: Array,  # (N, 3) its approximate outward unit normals there; 0 where unknown
    *,
    spacing: float,  # length of the mesh's edges
    tolerance: float,  # largest distance from each point to the mesh afterwards
) -> tuple[Array, Integers]:
    """Pull a closed mesh smoothly through points, together with their surroundings; it becomes finer there and stays closed.

    A point belongs to the nearest part of the mesh that faces the same way, so that the two sides of a thin body are not confused. First
    the displacement is the one that bends least (squared graph Laplacian), which takes details along; then, close to the points, the
    mesh itself bends least and passes near them. The other side of a thin body stays, since there nothing would hold it and it would
    shrink, unless a point is inside the body and may push it away. Points that remain farther than the tolerance become vertices.
    """
    if not (np.isfinite(points).all() and np.isfinite(normals).all()):
        raise InvalidInput("touched points or their normals are NaN or infinite; leave those touches out")
    if not len(points):
        return vertices, faces
    for number in range(ATTACHMENT_ROUNDS):
        nearest = _nearest_facing_points(vertices, faces, points, normals, spacing)
        for _ in range(2):  # each at most halves the edges
            ends, edge = mesh_edges(faces)
            long = np.flatnonzero(np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > 1.5 * spacing / REFINEMENT)
            away, _ = scipy.spatial.cKDTree(nearest[1]).query(vertices[ends[long]].mean(axis=1), distance_upper_bound=spacing)
            if not (away < spacing).any():
                break
            vertices, faces = split_edges(vertices, faces, ends, edge, long[away < spacing])
            nearest = _nearest_facing_points(vertices, faces, points, normals, spacing)
        vertices = _displace_vertices(vertices, faces, points, *nearest, spacing, coarse=not number)
    return _insert_points(vertices, faces, points, tolerance)


def _nearest_facing_points(
    vertices: Array, faces: Integers, points: Array, normals: Array, spacing: float
) -> tuple[Indices, Array]:  # (N,) faces, (N, 3)
    """Find the face that each point belongs to, and its closest point."""
    corners = vertices[faces]
    facing = unit_vectors(face_cross_products(corners))
    weight = NORMAL_WEIGHT * spacing / np.sqrt(2)
    tree = scipy.spatial.cKDTree(np.concatenate([corners.mean(axis=1), weight * facing], axis=1), balanced_tree=False)
    count = min(CANDIDATES, len(faces))
    candidates = tree.query(np.concatenate([points, weight * normals], axis=1), k=count)[1].reshape(-1)  # (N count)
    repeated = np.repeat(points, count, axis=0)
    closest: Array = trimesh.triangles.closest_point(corners[candidates], repeated)  # type: ignore[no-untyped-call]
    best = np.linalg.norm(closest - repeated, axis=1).reshape(-1, count).argmin(axis=1) + count * np.arange(len(points))
    return candidates[best], closest[best]


def _displace_vertices(
    vertices: Array, faces: Integers, points: Array, face: Indices, closest: Array, spacing: float, *, coarse: bool
) -> Array:
    """Displace the vertices around the closest points so that these come near the points; with `coarse`, details keep their shape."""
    offset = points - closest
    pulled = np.minimum(FALLOFF * np.linalg.norm(offset, axis=1), LARGEST_SHARE * float(np.ptp(vertices, axis=0).max()))
    distances, nearest = scipy.spatial.cKDTree(closest).query(vertices, distance_upper_bound=REACH * spacing + pulled.max())
    nearest[np.isinf(distances)] = 0  # no point is so near that it moves the vertex
    pulled = pulled[nearest]
    corners = vertices[faces[face]]
    outwards = face_cross_products(corners)
    facing = np.einsum("ni,ni->n", vertex_normals(vertices, faces), outwards[nearest])
    inwards = np.einsum("ni,ni->n", offset, outwards)[nearest] < 0
    movable = ((facing > 0) & (distances < REACH * spacing + pulled)) | (inwards & (distances < pulled))
    weights = 1 / np.maximum(np.linalg.norm(corners - closest[:, None], axis=2), 1e-3 * spacing)  # enough: the next round pulls again
    weights /= weights.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), 3)
    constraints = scipy.sparse.csr_array((weights.ravel(), (rows, faces[face].ravel())), shape=(len(points), len(vertices)))[:, movable]
    laplacian = neighbour_means(faces, len(vertices)) - scipy.sparse.eye_array(len(vertices), format="csr")
    bending = laplacian[:, movable]
    unheld = 1e-9 * scipy.sparse.eye_array(bending.shape[1])  # for parts that nothing holds
    system = constraints.T @ constraints + STIFFNESS * bending.T @ bending + unheld
    displaced = vertices.copy()
    shape = 0 if coarse else STIFFNESS * bending.T @ (laplacian @ vertices)
    displaced[movable] += scipy.sparse.linalg.splu(system.tocsc()).solve(constraints.T @ offset - shape)
    return displaced


def _insert_points(vertices: Array, faces: Integers, points: Array, tolerance: float) -> tuple[Array, Integers]:
    """Make vertices of the points that are farther from the mesh than the tolerance; each splits its nearest face into three."""
    while True:
        squared, face, _ = igl.point_mesh_squared_distance(points, vertices, faces)
        order = np.argsort(-squared, kind="stable")
        order = order[squared[order] > tolerance**2]
        if not len(order):
            return vertices, faces
        split, first = np.unique(face[order], return_index=True)  # one point per face and round: new vertices stay
        a, b, c = faces[split].T
        new = len(vertices) + np.arange(len(split))
        new_faces = [np.stack(corners, axis=1) for corners in ((a, b, new), (b, c, new), (c, a, new))]
        vertices = np.concatenate([vertices, points[order[first]]])
        faces = np.concatenate([np.delete(faces, split, axis=0), *new_faces])
