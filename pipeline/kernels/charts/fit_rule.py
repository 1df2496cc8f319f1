"""When the fitting of a touch chart ends, and what it is made of on the way there (supplement 2.3)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.charts.chart_square import SIDE


class StopRule(IntEnum):
    """Why a chart's fitting ended: there was nothing to fit to, or the halt, or the cap, or nothing left to draw points from."""

    no_touch = 0
    threshold = 1
    cap = 2
    too_few_points = 3
    collapsed = 4


@dataclass(frozen=True)
class FitRule:
    """How charts are fitted. The defaults are fast; the supplement's own is `SUPPLEMENT`.

    Attributes
    ----------
    halt
        Chamfer distance, sensor widths², below which a chart is done.
    residual_limit
        Sensor widths; what the RMS distance from cloud to chart must not exceed either, or None.
    max_iterations
        Steps after which a chart is taken as it is.
    samples
        Points of the chart in the Chamfer distance that is held against `halt`. Where chart and cloud are one surface of area A
        it is still A / (π samples) and as much again from the cloud's own density: `halt` must lie above.
    step_samples, cloud_points
        Points of the chart, and of the cloud, in the loss of a step; None is all of the cloud. Fewer are faster, and the
        exact loss decides all the same.
    check_every
        Steps from one look at the exact loss to the next, once it may be below the halt. Where every step has all samples
        and points each is a look.
    learning_rate
        Adam's, sensor widths a step.
    side
        Vertices along a side of the chart, odd.
    """

    halt: float = 6e-4
    residual_limit: float | None = None
    max_iterations: int = 1000
    samples: int = 4000
    step_samples: int = 500
    cloud_points: int | None = 500
    check_every: int = 10
    learning_rate: float = 1e-2
    side: int = SIDE

    def __post_init__(self) -> None:
        for name in ("halt", "samples", "step_samples", "check_every", "learning_rate", "residual_limit", "cloud_points"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} is {value}: a fit needs a finite number above 0")
        if self.max_iterations < 0:
            raise ValueError(f"max_iterations is {self.max_iterations}: 0 at least, which leaves the square")

    @property
    def always_exact(self) -> bool:
        """Whether every step has all samples and points."""
        return self.step_samples >= self.samples and self.cloud_points is None


SUPPLEMENT = FitRule(step_samples=4000, cloud_points=None, check_every=1, learning_rate=3e-3)
"""Section 2.3 to the letter: one loss, of all points, for the steps and the halt."""


def residual(vertices: NDArray[np.float64], faces: NDArray[np.integer], points: NDArray[np.float64]) -> float:
    """The root of the mean squared distance from `points` (n, 3) to a surface, `vertices` (V, 3) and `faces` (F, 3); in their unit.

    Exact: to the nearest place of a triangle, not to its corners or to samples; triangles may be slivers, segments or points.
    Within 1e-13 of the largest coordinate; beside slivers libigl's distance is too large, by a millionth of their length at an aspect
    of 1e6, and by up to a tenth of it beyond 1e8.

    Raises
    ------
    ValueError
        There is no point or no face, or something is NaN or infinite.
    """
    if not len(points) or not len(faces):
        raise ValueError(f"{len(points)} points, {len(faces)} faces: a distance takes one of each at least")
    if not (np.isfinite(points).all() and np.isfinite(vertices).all()):
        raise ValueError("points or vertices hold NaN or infinity: nothing has a distance from them")
    arrays = (np.ascontiguousarray(points), np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64))
    return float(np.sqrt(np.mean(igl.point_mesh_squared_distance(*arrays)[0])))
