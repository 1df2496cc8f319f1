"""The options of a touch chart's fit, and why a fit ended (supplement 2.3)."""

from __future__ import annotations

from enum import IntEnum

from pydantic import ConfigDict, NonNegativeInt, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass

from pipeline.kernels.charts.touch_chart import SIDE


class StopRule(IntEnum):
    """The end of a chart's fit: no touch, the loss below the threshold, the cap on steps, no points to fit to, or no area left."""

    no_touch = 0
    threshold = 1
    cap = 2
    too_few_points = 3
    collapsed = 4


@dataclass(frozen=True, config=ConfigDict(allow_inf_nan=False))
class FitOptions:
    """Options of a chart's fit. The defaults are fast; the supplement (2.3) has one loss, of all points, for the steps and the halt.

    Attributes
    ----------
    halt
        Chamfer distance, sensor widths², below which a chart is done. Where chart and cloud are one surface of area A it is still
        A / (π samples), and as much again from the cloud's own density: `halt` must lie above.
    residual_limit
        Largest RMS distance from cloud to chart of a finished chart, sensor widths, or None.
    max_iterations
        Steps after which a fit ends; 0 leaves the square.
    samples
        Points of the chart in the Chamfer distance that is compared with `halt`.
    step_samples, cloud_points
        Points of the chart, and of the cloud, in the loss of a step; None is the whole cloud. Fewer are faster; the exact loss decides
        all the same.
    check_every
        Steps between two checks of the exact loss, once it may be below the halt. Where each step has all samples and points, each
        is a check.
    learning_rate
        Adam's, sensor widths per step.
    side
        Vertices along a side of the chart, odd.
    """

    halt: PositiveFloat = 6e-4
    residual_limit: PositiveFloat | None = None
    max_iterations: NonNegativeInt = 1000
    samples: PositiveInt = 4000
    step_samples: PositiveInt = 500
    cloud_points: PositiveInt | None = 500
    check_every: PositiveInt = 10
    learning_rate: PositiveFloat = 1e-2
    side: int = SIDE

    @property
    def always_exact(self) -> bool:
        """Whether each step has all samples and points."""
        return self.step_samples >= self.samples and self.cloud_points is None
