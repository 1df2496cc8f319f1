"""Orthographic depth: by exact intersection, scan conversion in float64, or by sphere tracing, the supplement's method (1.5).

Valid range: objects and sensors within 100 m of the origin, sensors 10 µm to 10 m wide; any faces, open and inside-out meshes.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array, Mask, check_shape
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products, flatness
from pipeline.kernels.geometry.transforms import unit_vectors
from pipeline.kernels.touch.sensor import Sensor, check_pose, pixel_centres

PLANE_TOLERANCE = 1e-9  # m behind the sensor plane within which a surface lies on it (depth 0): rounding must not lose it

Point = tuple[float, float, float]  # x in columns, y in rows (pixel centres: integers), z in m
SLACK = 1e-9  # m, by which boxes are enlarged: far above rounding errors within the valid range
TOLERANCE = 1e-7  # m before the surface at which a ray may stop: a tenth of the stated accuracy, for a fifth more time
MAX_STEPS = 100  # rays still under way (0.4 % on twenty real meshes, 7 % of the worst sensor) run along walls
SLIVER = 1e-3  # flatness below which sphere tracing intersects exactly: libigl's distance errs by 1e-16 / flatness² of a face


@compiled
def _edge_at_row(low: Point, high: Point, row: float) -> tuple[float, float]:  # column and depth
    if row == high[1]:
        return high[0], high[2]
    share = (row - low[1]) / (high[1] - low[1])
    return low[0] + share * (high[0] - low[0]), low[2] + share * (high[2] - low[2])


@compiled
def _face_at_row(a: Point, b: Point, c: Point, row: float) -> tuple[float, float, float, float]:
    """Compute the columns left <= right, each with its depth, between which a row of pixel centres crosses a face.

    An edge is followed from its lower to its upper row and meets its corners exactly: no ray passes between two faces that share it.
    """
    long = _edge_at_row(a, c, row)
    short = _edge_at_row(b, c, row) if row > b[1] else _edge_at_row(a, b, row)
    return (*short, *long) if short[0] < long[0] else (*long, *short)


@compiled
def scan_convert(faces: Array, width: float, height: float, depth: Array) -> None:
    """Lower a depth map (rows, cols), m, where faces (3 axes, 3 corners, N), sensor frame, m, are nearer; arrays are contiguous."""
    rows, cols = depth.shape
    for face in range(faces.shape[2]):
        a, b, c = [((x / width + 0.5) * cols - 0.5, (y / height + 0.5) * rows - 0.5, z) for x, y, z in faces[:, :, face].T]
        if b[1] < a[1]:  # in the order of their rows
            a, b = b, a
        if c[1] < b[1]:
            b, c = c, b
        if b[1] < a[1]:
            a, b = b, a
        if a[1] == c[1]:
            continue
        for row in range(int(max(math.ceil(a[1]), 0.0)), int(min(math.floor(c[1]), rows - 1.0)) + 1):
            left, z_left, right, z_right = _face_at_row(a, b, c, float(row))
            if right > left:
                slope = (z_right - z_left) / (right - left)
            else:
                slope, z_left = 0.0, min(z_left, z_right)
            line = depth[row]
            for col in range(int(max(math.ceil(left), 0.0)), int(min(math.floor(right), cols - 1.0)) + 1):
                z = z_left + slope * (col - left)
                line[col] = min(line[col], max(0.0, z) if z >= -PLANE_TOLERANCE else math.inf)


@dataclass(frozen=True, eq=False)
class BoxedFaces:
    """The faces of a mesh with their axis-aligned bounding boxes, world frame, m."""

    corners: Array  # (3 axes, 3 corners, F)
    centre: Array  # (3, F) of each box
    half: Array  # (3, F) half extent


def box_faces(triangles: np.ndarray) -> BoxedFaces:
    """Compute the bounding boxes of the faces (F, 3, 3), world, m, of a mesh, once per object; F may be 0."""
    triangles = np.asarray(triangles, np.float64)
    check_shape("triangles", triangles, "F", 3, 3)
    check_coordinates(triangles.reshape(-1, 3), "corners of faces")
    corners = np.ascontiguousarray(triangles.transpose(2, 1, 0))
    low, high = corners.min(axis=1), corners.max(axis=1)  # (3, F)
    return BoxedFaces(corners, (low + high) / 2, (high - low) / 2)


def cull_faces(faces: BoxedFaces, pose: np.ndarray, sensor: Sensor) -> Array:  # (3 axes, 3 corners, N) sensor frame, m
    """Select the faces that rays of a sensor at a pose (4, 4) can meet, and few others; shared corners stay equal to the bit."""
    pose = check_pose(pose)
    high = np.array([sensor.width / 2, sensor.height / 2, sensor.range]) + SLACK
    low = np.array([-sensor.width / 2, -sensor.height / 2, 0.0]) - SLACK
    return _cull(faces.corners, faces.centre, faces.half, pose[:3, :3].copy(), pose[:3, 3].copy(), low, high)


@compiled
def _cull(corners: Array, centre: Array, half: Array, rotation: Array, origin: Array, low: Array, high: Array) -> Array:
    """Select the faces whose boxes, in the world frame and then in the sensor's, meet a box (3,) to (3,) of the sensor frame."""
    kept, local = 0, np.empty(corners.shape)
    for face in range(corners.shape[2]):
        meets = True
        for axis in range(3):
            at, reach = 0.0, 0.0
            for k in range(3):
                at += rotation[k, axis] * (centre[k, face] - origin[k])
                reach += abs(rotation[k, axis]) * half[k, face]
            if at - reach > high[axis] or at + reach < low[axis]:
                meets = False
                break
        for axis in range(3 if meets else 0):
            for corner in range(3):
                x, y, z = (corners[0, corner, face] - origin[0], corners[1, corner, face] - origin[1], corners[2, corner, face] - origin[2])
                local[axis, corner, kept] = rotation[0, axis] * x + rotation[1, axis] * y + rotation[2, axis] * z
            a, b, c = local[axis, :, kept]
            meets &= min(a, b, c) <= high[axis] and max(a, b, c) >= low[axis]
        kept += meets
    return local[:, :, :kept].copy()


def ray_depth(faces: BoxedFaces, pose: np.ndarray, sensor: Sensor) -> Array:
    """Compute the depth map of a sensor at a pose (4, 4): (rows, cols) m, +inf where nothing is met within its range.

    D is the distance along +z to the first surface (supplement 1.5). Front and back of a face count alike, and its rim belongs to it. A
    face seen exactly edge-on may be met at its nearest point or not; the rims of its neighbours are met.

    >>> floor = np.array([[[-1, -1, 0.005], [3, -1, 0.005], [-1, 3, 0.005]]])
    >>> depth = ray_depth(box_faces(floor), np.eye(4), load_sensor("gel_16mm"))  # 5 mm everywhere
    """
    return local_depth(cull_faces(faces, pose, sensor), sensor)


def local_depth(local: Array, sensor: Sensor) -> Array:
    """Compute the depth map of faces from `cull_faces`; see `ray_depth`."""
    depth = np.full(sensor.shape, np.inf)
    scan_convert(np.ascontiguousarray(local), sensor.width, sensor.height, depth)
    depth[depth > sensor.range] = np.inf
    return depth


def sphere_traced_depth(
    faces: BoxedFaces,
    pose: np.ndarray,  # (4, 4) sensor frame to world frame
    sensor: Sensor,
    *,
    tolerance: float = TOLERANCE,  # m, > 0: a ray ends at most this far before the surface, measured along the ray
) -> Array:  # (rows, cols) m from the sensor plane; +inf where nothing is met within the sensor's range
    """Compute the depth map of a sensor by sphere tracing; the result is that of `ray_depth` to within `tolerance`.

    The distance is that to the faces the sensor can see: no less than that to the mesh, no more than the free length of the ray. Rays
    that `trace_spheres` leaves unsettled (along walls, past silhouettes) are intersected exactly, and so are slivers.
    """
    local = cull_faces(faces, pose, sensor)
    sliver = flatness(local.transpose(2, 1, 0)) < SLIVER
    depth, settled = trace_spheres(local[:, :, ~sliver], sensor, tolerance=tolerance)
    depth = np.minimum(depth, local_depth(local[:, :, sliver], sensor))
    return np.where(settled, depth, local_depth(local, sensor))


def trace_spheres(
    local: Array,  # (3 axes, 3 corners, N) from `cull_faces`, sensor frame, m, none flatter than `SLIVER`
    sensor: Sensor,
    *,
    tolerance: float,  # as in `sphere_traced_depth`
) -> tuple[Array, Mask]:  # depth (rows, cols) m, +inf for a miss; settled (rows, cols)
    """Trace spheres along every ray, without exact intersection of unsettled rays.

    A hit is settled when the face at which the ray stops lies across the ray, at most `tolerance` ahead; a miss when the ray has passed
    every face or the range.
    """
    depth = np.full(sensor.rows * sensor.cols, np.inf)
    settled = np.ones(len(depth), bool)
    if local.shape[2] == 0:
        return depth.reshape(sensor.shape), settled.reshape(sensor.shape)
    x, y = pixel_centres(sensor)
    points = np.stack([np.tile(x, sensor.rows), np.repeat(y, sensor.cols), np.zeros(len(depth))], axis=1)
    points[:, 2] = max(local[2].min() - tolerance, 0.0)  # no face is nearer to the plane
    end = min(local[2].max() + PLANE_TOLERANCE, sensor.range)
    corners = np.ascontiguousarray(local.transpose(2, 1, 0))  # (N, corner, xyz)
    vertices, faces = corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3)
    import igl  # and SciPy's sparse matrices with it

    tree = igl.AABB()
    tree.init(vertices, faces)
    cosine = np.abs(unit_vectors(face_cross_products(corners))[:, 2])  # of the angle between each face's normal and the rays
    active = np.arange(len(depth))
    for _ in range(MAX_STEPS):
        squared, nearest, _ = tree.squared_distance(vertices, faces, points[active])
        distance = np.sqrt(squared)
        arrived = distance <= tolerance * cosine[nearest]
        stop = active[arrived]
        gap = _gap_along_ray(corners[nearest[arrived]], points[stop])
        height = points[stop, 2]
        across = (gap >= -PLANE_TOLERANCE) & (gap <= 2 * tolerance)  # twice: rounding may not undo `arrived`
        across &= height + gap <= sensor.range
        depth[stop[across]] = height[across]
        settled[stop[~across]] = False
        active, distance = active[~arrived], distance[~arrived]
        points[active, 2] += distance
        active = active[points[active, 2] <= end]
        if not len(active):
            break
    settled[active] = False
    return depth.reshape(sensor.shape), settled.reshape(sensor.shape)


def _gap_along_ray(corners: Array, points: Array) -> Array:  # (n,) m
    """Compute the distance along +z from each point to its face (n, 3, 3); NaN where the ray does not pass through."""
    edge = corners - points[:, None]  # the point as the origin
    weight = np.cross(np.roll(edge, -1, 1), np.roll(edge, -2, 1))[:, :, 2]  # (n, 3)
    area = weight.sum(axis=1)
    through = ((weight >= 0).all(axis=1) | (weight <= 0).all(axis=1)) & (area != 0)
    height = (weight * edge[:, :, 2]).sum(axis=1)
    gap: Array = np.divide(height, area, out=np.full_like(area, np.nan), where=through)
    return gap
