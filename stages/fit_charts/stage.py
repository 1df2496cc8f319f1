"""Supplement 2.3: a chart for each touch, bent from the sensor's square to the points of its depth map."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.touch_sensors import touch_sensor
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.charts.touch_chart import StopRule, chart_square
from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.kernels.touch.sensor import Sensor, check_pose, masked_points, sensor_to_world
from pipeline.models.touch_model import TouchModel, load_touch_model
from pipeline.rng import torch_generator
from pipeline.store.rows import Row
from pipeline.training.device import torch_threads
from schemas.base import Artifact
from schemas.charts import CHARTS
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from stages.fit_charts.settings import ChartSettings

NETWORKS = {"predicted": "models/unet", "local": "models/touch"}
"""The folders of the networks of `train-unet` and `train-touch`, below the data directory, by `cloud`."""
TOUCHES = 18
"""Touches per object: nine in ten of the twenty sensors."""


class FitCharts(ObjectStage):
    """Fit charts of the surface to the touches of the sensors."""

    name = "fit-charts"
    summary = "A touch chart for every sensor of every grasp."
    output = CHARTS
    settings_type = ChartSettings

    def inputs(self, settings: ChartSettings) -> tuple[Artifact, ...]:
        """Name the inputs: tactile images and depths, the poses of the sensors, and which of them touch."""
        return (TOUCH, GRASPS)

    def models(self, settings: ChartSettings) -> tuple[str, ...]:
        """Name the folder of the network whose points the settings ask for."""
        return (NETWORKS[settings.cloud],) if settings.cloud in NETWORKS else ()

    def constants(self, settings: ChartSettings) -> Row:
        """Make the triangles, the same in each chart."""
        return {"chart_faces": chart_square(settings.side)[1].numpy().astype(np.int32)}

    def cost(self, settings: ChartSettings) -> Cost:
        """Estimate the touches of an object, as measured on one core."""
        steps = (5.0 if settings.tight else 1.0) * 0.01 / settings.learning_rate
        return Cost(seconds=TOUCHES * 0.04 * steps * settings.step_samples / 500, kilobytes=20)

    @contextmanager
    def session(self, settings: ChartSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Load the network that the settings use; compute on one thread per worker, for results that do not depend on their number."""
        with torch_threads(1):
            folder = models[NETWORKS[settings.cloud]] if settings.cloud in NETWORKS else None
            model = load_touch_model(folder, "cpu") if folder else None
            yield lambda unit, inputs: _process(unit, inputs, settings, model)


def _process(unit: Unit, inputs: Inputs, settings: ChartSettings, model: TouchModel | None) -> Row:
    sensor = touch_sensor(inputs["touch"].attributes)
    poses, touched = inputs["grasps"]["sensor_pose"], inputs["grasps"]["touch_success"]
    clouds = _clouds(inputs, touched, sensor, model)
    generators = [torch_generator(unit.seed, unit.name, "fit-charts", *at) for at in np.argwhere(touched).tolist()]
    options = settings.fit_options(sensor.width)
    fits = fit_charts(clouds, sensor.width, generators, aspect=sensor.aspect, options=options)
    charts = np.tile(chart_square(settings.side, sensor.aspect)[0].numpy() * sensor.width, (*touched.shape, 1, 1))
    charts[touched] = fits.vertices
    vertices = [sensor_to_world(check_pose(poses[at]), *charts[at].T) for at in np.ndindex(touched.shape)]
    row = {"vertices": np.stack(vertices).reshape(charts.shape).astype(np.float32)}
    for name, nothing in (("residual", np.float32(0)), ("iterations", np.int32(0)), ("stop_rule", np.uint8(StopRule.no_touch))):
        row[name] = np.full(touched.shape, nothing)
        row[name][touched] = getattr(fits, name)
    return row


def _clouds(inputs: Inputs, touched: NDArray[np.bool_], sensor: Sensor, model: TouchModel | None) -> list[NDArray[np.float64]]:
    """Predict the points (n, 3) of each touch by a network; without one, those with D < w. Sensor frame, m."""
    touch = inputs["touch"]
    if model is None:
        return [masked_points(depth, in_gel(depth, sensor), sensor) for depth in touch["depth"][touched].astype(np.float64)]
    model.check_sensor(sensor)
    return model.clouds(touch["tactile_image"][touched])
