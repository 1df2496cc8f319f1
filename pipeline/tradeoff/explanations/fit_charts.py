"""What `fit-charts` left out: sensors that felt nothing, pixels that did not touch, steps after the fit was good enough."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.dataset.touch_charts import is_surface
from pipeline.dataset.touch_sensors import touch_sensor
from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.models.touch_model import load_touch_model
from pipeline.tradeoff.explain import Count
from stages.fit_charts.settings import ChartSettings
from stages.fit_charts.stage import UNET


def explain(settings: ChartSettings, models: Mapping[str, Path], units: Sequence[tuple[Unit, Inputs]]) -> Iterator[Count]:
    """Count charts, tactile images, pixels and steps of these objects."""
    model = load_touch_model(models[UNET], settings.device) if settings.cloud == "predicted" else None
    for _, inputs in units:
        touched, own = inputs["grasps"]["touch_success"], inputs["charts"]
        sensors, felt = touched.size, int(touched.sum())
        fitted = int(is_surface(own["stop_rule"]).sum())
        yield Count("charts fitted", fitted, sensors - fitted, "nothing touched: the undeformed square")
        if model is None:
            depth = inputs["touch"]["depth"][touched]
            inside = int((depth < touch_sensor(inputs["touch"].attributes).w).sum())
            yield Count("tactile images through the U-Net", 0, felt, "`cloud` is true: the points are the depth map's")
            yield Count("points fitted to", inside, depth.size - inside, "beyond the gel")
        else:
            mask = model.mask(inputs["touch"]["tactile_image"][touched])
            yield Count("tactile images through the U-Net", felt, sensors - felt, "nothing touched")
            yield Count("points fitted to", int(mask.sum()), int((~mask).sum()), "the pixel shows no contact")
        taken = int(own["iterations"].sum())
        yield Count("steps", taken, fitted * settings.max_iterations - taken, "the chart was near enough")
