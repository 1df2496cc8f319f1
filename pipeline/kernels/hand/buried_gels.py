"""Find gels that lie inside the links that carry them: an object meets the link first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.model import Hand, Link
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor

ROUNDED = 5e-4  # m, that a sensor plane may lie below its link's surface: origins are rounded, and meshes have facets
MEETING = 1e-6  # m between shapes that count as one


def buried_gels(hand: Hand, sensors: Sequence[Sensor]) -> Iterator[tuple[bool, str]]:
    """Describe the sensors of a hand whose plane lies below their link's surface.

    Yield whether all of the gel does, in its middle, and a sentence with the remedy.
    """
    for mount, sensor in zip(hand.sensors, sensors, strict=True):
        link, (origin, normal), top = hand.links[mount.link], (mount.pose[:3, 3], mount.pose[:3, 2]), gel_top(sensor)
        depth = depth_in_link(link, origin, normal, ahead=top)
        if depth <= ROUNDED:
            continue
        remedy = f"move its `origin` by {1e3 * depth:.3g} mm, to {_listed(origin + depth * normal)}"
        if depth_in_link(link, origin, -normal, ahead=top) <= ROUNDED:
            remedy = f"its normal points into the link: write `normal: {_listed(-normal)}`"
        if depth < top:
            name = f"the sensor plane of {mount.name} lies inside its link {link.name}"
            yield False, f"{name}, so that objects meet only the outer {1e3 * (top - depth):.2g} mm of its gel; {remedy}"
        else:
            yield True, f"the gel of {mount.name} lies inside its link {link.name}, which objects meet first; {remedy}"


def depth_in_link(link: Link, point: Array, direction: Array, *, ahead: float) -> float:
    """Compute how far a point lies below a link's surface along a direction, both (3,) in the link's frame, m; 0 where nothing covers it.

    Collision shapes count as convex, as physics takes them; one that begins less than `ahead`, m, in front of the point covers it too.
    """
    spans = []
    for shape in link.collisions:
        try:
            normals, offsets = np.split(scipy.spatial.ConvexHull(shape.mesh.vertices).equations, [3], axis=1)
        except (scipy.spatial.QhullError, ValueError):  # it is flat or not finite, and reported elsewhere
            continue
        slope, height = normals @ direction, normals @ point + offsets[:, 0]  # (F,), the latter positive outside
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
