"""Cuts through an object, upright and along its longer side."""

from typing import Any

import numpy as np
import trimesh
from matplotlib.collections import LineCollection
from numpy.typing import NDArray


def cutting_plane(points: NDArray[np.float64]) -> tuple[int, float]:
    """Find the upright plane through the middle of points along their longer side: its normal's axis, and where it is, m."""
    axis = int(np.ptp(points[:, :2], axis=0).argmin())
    return axis, float((points[:, axis].min() + points[:, axis].max()) / 2)


def outline(axes: Any, mesh: Any, across: int, offset: float, color: str) -> None:
    """Draw the lines in which a mesh is cut."""
    normal = np.eye(3)[across]
    cut = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    lines: Any = trimesh.intersections.mesh_plane(cut, normal, offset * normal)  # type: ignore[no-untyped-call]
    axes.add_collection(LineCollection(lines[:, :, [axis for axis in range(3) if axis != across]], colors=color, linewidths=1))


def frame_cut(axes: Any) -> None:
    """Show what was drawn of a cut, in true proportions."""
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
