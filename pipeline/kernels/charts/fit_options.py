"""The options of a touch chart's fit, and why a fit ended (supplement 2.3)."""

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

    Where chart and cloud are one surface of area A, their Chamfer distance is still A / (π samples), and as much again
    from the cloud's own density: `halt` must lie above. Fewer `step_samples` and `cloud_points` are faster; the exact
    loss decides all the same. Where each step has all samples and points, each is a check.
    """

    halt: PositiveFloat = 6e-4  # sensor widths², Chamfer distance below which a chart is done
    residual_limit: PositiveFloat | None = None  # sensor widths, greatest RMS distance from cloud to finished chart
    max_iterations: NonNegativeInt = 1000  # steps after which a fit ends; 0 leaves the square
    samples: PositiveInt = 4000  # points of the chart in the Chamfer distance that is compared with `halt`
    step_samples: PositiveInt = 500  # points of the chart in the loss of a step
    cloud_points: PositiveInt | None = 500  # points of the cloud in the loss of a step; None is the whole cloud
    check_every: PositiveInt = 10  # steps between two checks of the exact loss, once it may be below the halt
    learning_rate: PositiveFloat = 1e-2  # Adam's, sensor widths per step
    side: int = SIDE  # vertices along a side of the chart, odd

    @property
    def always_exact(self) -> bool:
        """Whether each step has all samples and points."""
        return self.step_samples >= self.samples and self.cloud_points is None
