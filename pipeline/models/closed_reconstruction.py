"""Reconstructions as closed surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.geometry.closed_surface import RESOLUTION, closed_surface
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction


def joined(made: Reconstruction) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Join the vision charts to one closed surface: vertices (P, 3), one per distinct position, m, and faces (F, 3)."""
    position = made.position
    count = np.bincount(position)
    vertices = np.stack([np.bincount(position, weights=axis) for axis in made.vertices[: made.vision].T], axis=1) / count[:, None]
    return vertices, position[made.faces[(made.faces < made.vision).all(axis=1)]]


def closed(
    made: Reconstruction, resolution: int = RESOLUTION, given: Observation | None = None
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Make one closed, smooth mesh of a reconstruction, through the vertices of touch charts; see `closed_surface`.

    These are its own, unless it is said what was given: an implicit network's reconstruction holds no charts.
    """
    charts = made.vertices[made.vision :] if given is None else given.touch_vertices[given.touched]
    return closed_surface(*joined(made), charts.reshape(-1, made.side**2, 3), chart_square(made.side)[1].numpy(), resolution=resolution)
