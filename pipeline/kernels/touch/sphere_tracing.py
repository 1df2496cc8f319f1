"""Orthographic depth by sphere tracing on the unsigned distance, the supplement's method (1.5). Valid range: that of `ray_depth`."""

import numpy as np

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.mesh import face_cross_products, flatness
from pipeline.kernels.geometry.transforms import unit_vectors
from pipeline.kernels.touch.ray_depth import PLANE_TOLERANCE, BoxedFaces, cull_faces, local_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres

TOLERANCE = 1e-7  # m before the surface at which a ray may stop: a tenth of the stated accuracy, for a fifth more time
MAX_STEPS = 100  # rays still under way (0.4 % on twenty real meshes, 7 % of the worst sensor) run along walls
SLIVER = 1e-3
"""Flatter faces are intersected exactly. libigl's distance to a face has an error of some 1e-16 / flatness² of its length: more than
`TOLERANCE` from 1e-5 on, all of it at 1e-8, and a ray that trusts it steps through the face."""


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
    max_steps: int = MAX_STEPS,  # after which a ray counts as unsettled
) -> tuple[Array, Mask]:  # depth (rows, cols) m, +inf for a miss; settled (rows, cols)
    """Trace spheres along every ray, without exact intersection of unsettled rays.

    A hit is settled when the face at which the ray stops lies across the ray, at most `tolerance` ahead; a miss when the ray has passed
    every face or the range.
    """
    if not tolerance > 0 or max_steps < 1:
        raise ValueError(f"sphere tracing needs tolerance > 0 and max_steps >= 1, not {tolerance} and {max_steps}")
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
    for _ in range(max_steps):
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
