"""Supplement 2.3: a chart for each touch, bent from the sensor's square to the points of its depth map."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import field_validator

from pipeline.config.settings import ObjectSettings, defining, setting
from pipeline.dataset.object_rows import ObjectRows, is_surface, sensor_of
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Trade, Unit
from pipeline.kernels.charts.touch_chart import SIDE, FitOptions, chart_square
from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.kernels.touch.sensor import check_pose, masked_points, sensor_to_world
from pipeline.rng import torch_generator
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.charts import CHARTS, StopRule
from schemas.grasps import GRASPS
from schemas.touch import TOUCH

NETWORKS = {"predicted": "models/unet", "local": "models/touch"}
"""The folders of the networks of `train-unet` and `train-touch`, below the data directory, by `cloud`."""
TOUCHES = 18  # touches per object: nine in ten of the twenty sensors
TIGHT_HALT = 2.3e-4  # sensor widths²: the part above the floor of 4000 samples (1e-4 to 1.6e-4) is about 100 µm
TIGHT_RESIDUAL = 1e-4  # m: the RMS distance from cloud to chart that `tight` promises


class ChartSettings(ObjectSettings):
    """How touch charts are fitted to point clouds (supplement 2.3)."""

    cloud: Literal["predicted", "local", "true"] = defining(
        "predicted",
        "the points a trained U-Net sees in the tactile image, the supplement's way; `local`: those that `train-touch`'s network reads "
        "(with train-touch.pretrained=shipped, the pretrained one); "
        "`true` are those of the depth map",
    )
    halt: float = setting(6e-4, "Chamfer distance, sensor widths², below which a chart is done: the supplement's", gt=0)
    residual_limit: float | None = setting(
        2.5e-4, "m, RMS from cloud to chart: the halt alone leaves a fifth of the charts at 250 to 330 µm; null is the supplement", gt=0
    )
    tight: bool = setting(False, "true halts at 2.3e-4 sensor widths² and 100 µm RMS, which takes nearly four times as long")
    max_iterations: int = setting(1000, "nearly all charts halt earlier, even tight ones; others gain little later", ge=1, le=10_000)
    samples: int = setting(4000, "points of the chart in the loss held against the halt: 1000 never reach it", ge=1, le=50_000)
    step_samples: int = setting(500, "points in a step's loss: several times faster than all; below 60 µm take 2000", ge=1, le=50_000)
    cloud_points: int | None = setting(500, "points of the cloud in a step's loss, others each step; null takes all", ge=1, le=50_000)
    check_every: int = setting(10, "steps between checks of the exact loss; 1 acts as 2 unless each step takes all points", ge=1, le=100)
    learning_rate: float = setting(1e-2, "Adam's, sensor widths: charts as near as with the supplement's 3e-3, in a third the time", gt=0)
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


class FitCharts(ObjectStage):
    """Fit charts of the surface to the touches of the sensors."""

    name = "fit-charts"
    summary = "A touch chart for every sensor of every grasp."
    output = CHARTS
    settings_type = ChartSettings

    def inputs(self, settings: ChartSettings) -> tuple[Artifact, ...]:
        return (TOUCH, GRASPS)

    def models(self, settings: ChartSettings) -> tuple[str, ...]:
        """Name the folder of the network whose points the settings ask for."""
        return (NETWORKS[settings.cloud],) if settings.cloud in NETWORKS else ()

    def constants(self, settings: ChartSettings) -> Row:
        return {"chart_faces": chart_square(settings.side)[1].numpy().astype(np.int32)}

    def cost(self, settings: ChartSettings) -> Cost:
        """Estimate the touches of an object, as measured on one core."""
        steps = (5.0 if settings.tight else 1.0) * 0.01 / settings.learning_rate
        return Cost(seconds=TOUCHES * 0.04 * steps * settings.step_samples / 500, kilobytes=20)

    @contextmanager
    def session(self, settings: ChartSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Load the network that the settings use; compute on one thread per worker, for results that do not depend on their number."""
        from pipeline.kernels.charts.chart_fitting import fit_charts
        from pipeline.models.device import torch_threads
        from pipeline.models.touch_model import load_touch_model

        model = load_touch_model(models[NETWORKS[settings.cloud]], "cpu") if settings.cloud in NETWORKS else None

        def process(unit: Unit, inputs: Inputs) -> Row:
            touch, sensor = inputs["touch"], sensor_of(inputs["touch"].shard)
            poses, touched = inputs["grasps"]["sensor_pose"], inputs["grasps"]["touch_success"]
            if model is None:
                clouds = [masked_points(depth, in_gel(depth, sensor), sensor) for depth in touch["depth"][touched].astype(np.float64)]
            else:
                model.check_sensor(sensor)
                clouds = model.clouds(touch["tactile_image"][touched])
            generators = [torch_generator(unit.seed, unit.name, "fit-charts", *at) for at in np.argwhere(touched).tolist()]
            fits = fit_charts(clouds, sensor.width, generators, aspect=sensor.aspect, options=settings.fit_options(sensor.width))
            charts = np.tile(chart_square(settings.side, sensor.aspect)[0].numpy() * sensor.width, (*touched.shape, 1, 1))
            charts[touched] = fits.vertices
            vertices = [sensor_to_world(check_pose(poses[at]), *charts[at].T) for at in np.ndindex(touched.shape)]
            row = {"vertices": np.stack(vertices).reshape(charts.shape).astype(np.float32)}
            for name, nothing in (("residual", np.float32(0)), ("iterations", np.int32(0)), ("stop_rule", np.uint8(StopRule.no_touch))):
                row[name] = np.full(touched.shape, nothing)
                row[name][touched] = getattr(fits, name)
            return row

        with torch_threads(1):
            yield process


def residuals(data: Path, reference: Path) -> dict[str, float]:
    """Compute the mean RMS distance from clouds to their charts, um by object."""
    rows = ObjectRows(data, ("residual", "stop_rule"), split=None)
    residual_by_object = {}
    for name in rows.object_ids:
        fitted = is_surface(rows.read("stop_rule", name))
        if fitted.any():
            residual_by_object[name] = 1e6 * float(rows.read("residual", name)[fitted].mean())
    return residual_by_object


TRADE = Trade(
    metric="cloud to chart, mean RMS",
    unit="um",
    candidates=({"halt": 1.2e-3}, {"step_samples": 250}, {"step_samples": 1000}, {"tight": True}),
    errors=residuals,
)
