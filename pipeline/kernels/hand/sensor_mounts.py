"""How sensors lie on the surfaces of the links that carry them."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import compose, invert_pose, length, transform_points
from pipeline.kernels.hand.convex_shapes import nearest_faces
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.model import Hand, Mount
from pipeline.kernels.hand.self_collision import rigid_bodies
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor

ROUNDED = 5e-4  # m, that a sensor plane may lie below its link's surface: origins are rounded, and meshes have facets
STANDING_OFF, FAR_OFF = 1e-3, 5e-3  # m in front of its link from which a sensor plane is reported, and from which nothing carries it
SELDOM = 0.1  # share of the distances drawn from object to palm, below which a sensor on the palm seldom touches
MEETING = 1e-6  # m between shapes that count as one


class SurfacePoint(NamedTuple):
    """A point of a link's surface, in the link's frame."""

    point: Array  # (3,) m
    normal: Array  # (3,) unit, outward
    distance: float  # m, from the point that it is nearest to


class Hull(NamedTuple):
    """A convex hull in a link's frame: its planes, the outward normals first, and its mesh, a face per plane."""

    planes: Array  # (F, 4) unit normals and offsets, m
    mesh: Mesh


def hulls_of(hand: Hand, link: int) -> list[Hull]:
    """Compute the hulls of the collision shapes of a link and of all that is fixed to it, as physics takes them, in its frame."""
    bodies, hulls = rigid_bodies(hand), []
    frames = forward_kinematics(hand, np.eye(4), np.clip(0.0, hand.lower, hand.upper))
    for number in np.flatnonzero(bodies == bodies[link]).tolist():
        to_link = compose(invert_pose(frames[link]), frames[number])
        for shape in hand.links[number].collisions:
            try:
                hull = scipy.spatial.ConvexHull(transform_points(to_link, shape.mesh.vertices))
            except (scipy.spatial.QhullError, ValueError):  # it is flat or not finite, and reported elsewhere
                continue
            hulls.append(Hull(hull.equations, Mesh.bare(hull.points, hull.simplices)))
    return hulls


def nearest_surface(
    hulls: Sequence[Hull],  # at least one
    point: Array,  # (3,) m
    normal: Array,  # (3,) stated there: at an edge, the face that it fits best counts
) -> SurfacePoint:
    """Find the point of a link's surface that is nearest to a given one; faces whose middle lies within another hull are no surface."""
    nearest: list[tuple[bool, float, Array, int]] = []
    for number, (_, mesh) in enumerate(hulls):
        others = [*hulls[:number], *hulls[number + 1 :]]
        bare = Mesh.bare(mesh.vertices, mesh.faces[~_within(mesh.triangles.mean(axis=1), others)])
        if len(bare.faces):
            distances, _, points = nearest_faces(point[None], bare)
            nearest.append((bool(_within(points, others)[0]), float(distances[0]), points[0], number))
    _, distance, closest, number = min(nearest, key=lambda item: item[:2])
    planes = hulls[number].planes
    meeting = planes[np.abs(planes[:, :3] @ closest + planes[:, 3]) <= MEETING, :3]
    return SurfacePoint(closest, meeting[(meeting @ normal).argmax()], distance)


def _within(points: Array, hulls: Sequence[Hull]) -> Mask:  # (N,)
    """Find the points (N, 3) inside any of the hulls."""
    heights = [(points @ hull.planes[:, :3].T + hull.planes[:, 3]).max(axis=1) for hull in hulls]
    return np.any([height < -MEETING for height in heights], axis=0) if heights else np.zeros(len(points), bool)


def surface_notes(hand: Hand) -> Iterator[str]:
    """Describe the point of the link's surface that is nearest to the origin of each sensor, as entries of a hand file."""
    for mount in hand.sensors:
        if hulls := hulls_of(hand, mount.link):
            surface = nearest_surface(hulls, mount.pose[:3, 3], mount.pose[:3, 2])
            along = mount.pose[:3, int(abs(mount.pose[:3, 0] @ surface.normal) > 0.9)]
            columns = along - (along @ surface.normal) * surface.normal
            entries = f"origin: {_listed(surface.point)}, normal: {_listed(surface.normal)}, columns: {_listed(columns / length(columns))}"
            away = f"{round(1e3 * surface.distance, 3):.2g} mm from the origin of sensor {mount.name}"
            yield f"surface of {hand.links[mount.link].name}, {away}: {{{entries}}}"


def palm_notes(
    hand: Hand,
    sensors: Sequence[Sensor],
    least: float,  # m, from an object to the palm's centre
    greatest: float,
) -> Iterator[str]:
    """Describe sensors on the palm that hardly touch a flat object where a touch search sets the palm, each with the remedy."""
    poses = sensor_poses_from_links(hand, forward_kinematics(hand, np.eye(4), np.clip(0.0, hand.lower, hand.upper)))
    for mount, sensor, finger, pose in zip(hand.sensors, sensors, hand.sensor_fingers, poses, strict=True):
        front = float((pose[:3, 3] + gel_top(sensor) * pose[:3, 2] - hand.palm_centre) @ hand.palm_facing)
        if finger >= 0 or (front > least + SELDOM * (greatest - least) and pose[:3, 2] @ hand.palm_facing > 0):
            continue
        name, reach = f"the sensor {mount.name} of the palm", f"{1e3 * front:.3g} mm"
        if pose[:3, 2] @ hand.palm_facing <= 0:
            yield f"{name} cannot touch: it faces away from where palm.facing points; turn its normal, or palm.facing"
        elif front <= 0:
            yield f"{name} cannot touch: its gel lies {1e3 * abs(front):.3g} mm behind palm.centre; move that to the gel or behind it"
        else:
            yield (
                f"{name} {'cannot touch' if front <= least else 'seldom touches'} with search=touch: its gel reaches {reach} beyond "
                f"palm.centre, which is set {1e3 * least:g} to {1e3 * greatest:g} mm from an object; use --set "
                f"simulate-grasps.least_distance=0 --set simulate-grasps.greatest_distance={front:.3g}"
            )


def misplaced_sensors(hand: Hand, sensors: Sequence[Sensor]) -> Iterator[tuple[bool, str]]:  # whether it cannot touch so
    """Describe the sensors of a hand whose plane is off their link's surface, or whose normal points inwards, each with the remedy."""
    for mount, sensor in zip(hand.sensors, sensors, strict=True):
        if (hulls := hulls_of(hand, mount.link)) and (fault := _fault(mount, hand.links[mount.link].name, hulls, gel_top(sensor))):
            yield fault


def _fault(mount: Mount, link: str, hulls: Sequence[Hull], top: float) -> tuple[bool, str] | None:
    origin, normal = mount.pose[:3, 3], mount.pose[:3, 2]
    surface = nearest_surface(hulls, origin, normal)
    depth = depth_in_link(hulls, origin, normal, ahead=top)
    gap = 0.0 if _within(origin[None], hulls)[0] else surface.distance
    is_off = gap > STANDING_OFF
    distance, moved = (gap, surface.point) if is_off else (depth, origin + depth * normal)
    turn, move = f"write `normal: {_listed(-normal)}`", f"move its `origin` by {1e3 * distance:.3g} mm, to {_listed(moved)}"
    if surface.normal @ normal < 0 and depth_in_link(hulls, origin, -normal, ahead=top) <= ROUNDED:
        remedy = f"{turn}, and {move}" if is_off else turn
        return True, f"the gel of {mount.name} faces its link {link}, which objects meet first: its normal points into the link: {remedy}"
    if is_off:
        fault = f"the sensor plane of {mount.name} lies {1e3 * gap:.3g} mm in front of its link {link}, which does not carry it there"
        return gap > FAR_OFF, f"{fault}; {move}"
    if depth <= ROUNDED:
        return None
    if depth < top:
        name = f"the sensor plane of {mount.name} lies inside its link {link}"
        return False, f"{name}, so that objects meet only the outer {1e3 * (top - depth):.2g} mm of its gel; {move}"
    return True, f"the gel of {mount.name} lies inside its link {link}, which objects meet first; {move}"


def depth_in_link(hulls: Sequence[Hull], point: Array, direction: Array, *, ahead: float) -> float:
    """Compute how far a point lies below a link's surface along a direction, both (3,) in the link's frame, m; 0 where nothing covers it.

    A hull that begins less than `ahead`, m, in front of the point covers it too.
    """
    spans = []
    for hull in hulls:
        slope, height = hull.planes[:, :3] @ direction, hull.planes[:, :3] @ point + hull.planes[:, 3]  # (F,), the latter positive outside
        leaving, entering = slope > 1e-9, slope < -1e-9
        start, end = (-height[entering] / slope[entering]).max(), (-height[leaving] / slope[leaving]).min()
        if start < end and not (height[~leaving & ~entering] > 0).any():
            spans.append((start, end))
    depth = 0.0
    for start, end in sorted(spans):
        if start < max(ahead, depth + MEETING):
            depth = max(depth, float(end))
    return depth


def _listed(vector: Array) -> str:
    return f"[{', '.join(f'{number + 0.0:.4g}' for number in np.round(vector, 5))}]"
