"""The settings of `fit-charts`."""

from typing import Any, Literal

from pydantic import field_validator

from pipeline.config.settings import ObjectSettings, setting
from pipeline.kernels.charts.touch_chart import SIDE, FitOptions, chart_square

TIGHT_HALT = 2.3e-4
"""Sensor widths²: the part above the floor of 4000 samples (1e-4 to 1.6e-4) is about 100 µm."""
TIGHT_RESIDUAL = 1e-4
"""m: the RMS distance from cloud to chart that `tight` promises."""


class ChartSettings(ObjectSettings):
    """How touch charts are fitted to point clouds (supplement 2.3)."""

    cloud: Literal["predicted", "local", "true"] = setting(
        "predicted",
        "the points a trained U-Net sees in the tactile image, the supplement's way; `local`: those that `train-touch`'s network reads; "
        "`true` are those of the depth map",
        changes="definition",
    )
    halt: float = setting(6e-4, "Chamfer distance, sensor widths², below which a chart is done: the supplement's", gt=0)
    residual_limit: float | None = setting(
        2.5e-4,
        "m, RMS from cloud to chart: the halt alone leaves a fifth of the charts at 250 to 330 µm, ten steps short; null is the supplement",
        gt=0,
    )
    tight: bool = setting(False, "true halts at 2.3e-4 sensor widths² and 100 µm RMS, which takes nearly four times as long")
    max_iterations: int = setting(
        1000, "nearly all charts halt earlier, even tight ones; those that do not gain little later", ge=1, le=10_000
    )
    samples: int = setting(
        4000, "points of the chart in the loss that is held against the halt: with 1000 it would never be reached", ge=1, le=50_000
    )
    step_samples: int = setting(
        500, "points of the chart in a step's loss: several times faster than all; below 60 µm take 2000", ge=1, le=50_000
    )
    cloud_points: int | None = setting(500, "points of the cloud in a step's loss, others each step; null takes all", ge=1, le=50_000)
    check_every: int = setting(
        10, "steps between two checks of the exact loss; 1 acts as 2 unless each step takes all points", ge=1, le=100
    )
    learning_rate: float = setting(
        1e-2, "Adam's, sensor widths: charts as near as with the supplement's 3e-3, in a third of the time", gt=0
    )
    side: int = setting(SIDE, "vertices along a side: the supplement's 81 vertices and 128 faces")

    @field_validator("cloud", mode="before")
    @classmethod
    def _accept_yaml_true(cls, cloud: Any) -> Any:
        return "true" if cloud is True else cloud  # YAML reads the word true as a boolean

    @field_validator("side")
    @classmethod
    def _has_a_centre(cls, side: int) -> int:
        chart_square(side)
        return side

    def fit_options(self, width: float) -> FitOptions:
        """Convert to the kernel's options, in widths of a sensor of `width` m."""
        halt, residual = self.halt, self.residual_limit
        if self.tight:
            halt, residual = min(halt, TIGHT_HALT), min(residual or TIGHT_RESIDUAL, TIGHT_RESIDUAL)
        shared = {"max_iterations", "samples", "step_samples", "cloud_points", "check_every", "learning_rate", "side"}
        limit = None if residual is None else residual / width
        return FitOptions(halt=halt, residual_limit=limit, **self.model_dump(include=shared))
