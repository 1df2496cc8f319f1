"""Closed, smooth meshes of reconstructed surfaces, pulled through touched points."""

import igl
import numpy as np
import scipy
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Indices, Integers
from pipeline.kernels.geometry.mesh import face_cross_products, is_watertight, mesh_edges
from pipeline.kernels.geometry.surface_wrapping import neighbour_means, smooth_mesh, split_edges, vertex_normals, wrap_surface
from pipeline.kernels.geometry.transforms import unit_vectors

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


def closed_surface(
    vertices: Array,  # (V, 3) m
    faces: Integers,  # (F, 3); the surface may be crumpled, open, or cross itself
    charts: Floats,  # (K, S, 3) touch charts in the same frame, m; K may be 0
    chart_faces: Integers,  # (G, 3) of each chart, wound so that normals point into the object, as the sensor's do
    *,
    resolution: int = RESOLUTION,  # edges of the mesh along the longest side of the surface's box, `COARSEST` or more
) -> tuple[Array, Integers]:
    """Make one closed, smooth mesh of one part, normals outwards, that passes within 0.5 mm of each vertex of the touch charts.

    A bulge reaches those that were far from the surface.
    """
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
    normals = np.zeros(charts.shape)
    for number, chart in enumerate(charts):
        normals[number] = -vertex_normals(chart, chart_faces)
    points = charts.reshape(-1, 3).astype(np.float64)
    return attach_points(closed, sides, points, normals.reshape(-1, 3), spacing=spacing, tolerance=TOLERANCE)


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
        for _ in range(2):  # each at most halves the edges
            places = _nearest_facing_points(vertices, faces, points, normals, spacing)[1]
            ends, _edge = mesh_edges(faces)
            is_long = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > 1.5 * spacing / REFINEMENT
            is_near = scipy.spatial.cKDTree(places).query(vertices[ends].mean(axis=1))[0] < spacing
            vertices, faces = split_edges(vertices, faces, is_long & is_near)
        vertices = _displace_vertices(
            vertices, faces, points, *_nearest_facing_points(vertices, faces, points, normals, spacing), spacing, coarse=not number
        )
    return _insert_points(vertices, faces, points, tolerance)


def _nearest_facing_points(
    vertices: Array, faces: Integers, points: Array, normals: Array, spacing: float
) -> tuple[Indices, Array]:  # (N,) faces, (N, 3)
    """Find the face that each point belongs to, and the nearest place on it."""
    corners = vertices[faces]
    facing = unit_vectors(face_cross_products(corners))
    weight = NORMAL_WEIGHT * spacing / np.sqrt(2)
    tree = scipy.spatial.cKDTree(np.concatenate([corners.mean(axis=1), weight * facing], axis=1))
    count = min(CANDIDATES, len(faces))
    candidates = tree.query(np.concatenate([points, weight * normals], axis=1), k=count)[1].reshape(-1)  # (N count)
    repeated = np.repeat(points, count, axis=0)
    places: Array = trimesh.triangles.closest_point(corners[candidates], repeated)  # type: ignore[no-untyped-call]
    best = np.linalg.norm(places - repeated, axis=1).reshape(-1, count).argmin(axis=1) + count * np.arange(len(points))
    return candidates[best], places[best]


def _displace_vertices(
    vertices: Array, faces: Integers, points: Array, face: Indices, places: Array, spacing: float, *, coarse: bool
) -> Array:
    """Displace the vertices around the places so that these come to the points or near them; with `coarse`, details keep their shape."""
    offset = points - places
    distances, nearest = scipy.spatial.cKDTree(places).query(vertices)
    farthest = LARGEST_SHARE * float(np.ptp(vertices, axis=0).max())
    pulled = np.minimum(FALLOFF * np.linalg.norm(offset, axis=1)[nearest], farthest)
    corners = vertices[faces[face]]
    outwards = face_cross_products(corners)
    facing = np.einsum("ni,ni->n", vertex_normals(vertices, faces), outwards[nearest])
    inwards = np.einsum("ni,ni->n", offset, outwards)[nearest] < 0
    movable = ((facing > 0) & (distances < REACH * spacing + pulled)) | (inwards & (distances < pulled))
    weights = 1 / np.maximum(np.linalg.norm(corners - places[:, None], axis=2), 1e-3 * spacing)  # enough: the next round pulls again
    weights /= weights.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), 3)
    constraints = scipy.sparse.csr_array((weights.ravel(), (rows, faces[face].ravel())), shape=(len(points), len(vertices)))[:, movable]
    laplacian = neighbour_means(faces, len(vertices)) - scipy.sparse.eye_array(len(vertices), format="csr")
    bending = laplacian[:, movable]
    system = (
        constraints.T @ constraints + STIFFNESS * bending.T @ bending + 1e-9 * scipy.sparse.eye_array(bending.shape[1])
    )  # where nothing holds a part
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
