"""Settings of a sensor file against photographs of the sensor: `python -m benchmarks.tradeoff --only sensors`, with the package taxim."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_sensors import BALL, SETS, Model, added, least_ms, mean_errors, photographs
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.calibrated_shading import polynomial_background
from pipeline.kernels.touch.calibration_fit import Photograph, ball_impression
from pipeline.kernels.touch.optics import Shadow
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

NOISE = 2.0
"""Levels; photographs have 1 to 3."""


def sensor_settings() -> list[dict[str, Any]]:
    """Measure each shipped sensor with its settings changed one by one, on the photographs that it was not fitted to."""
    rows = []
    for name in SETS:
        some, untouched = photographs(name)
        shipped = load_sensor(name)
        for label, sensor, model in _variants(shipped, untouched):
            contact, ring = mean_errors(model, some[1::2], sensor)
            depth = sensor.w - ball_impression(shipped, some[1].contact, BALL)
            ms = least_ms(lambda d=depth, s=sensor: tactile_image(d, s, np.random.default_rng(0)))
            rows.append({"sensor": name, "label": label, "ms": round(ms, 2), "contact": round(contact, 2), "ring": round(ring, 2)})
    return rows


def _variants(shipped: Sensor, untouched: NDArray[np.uint8]) -> Iterator[tuple[str, Sensor, Model]]:
    """Label, sensor, and how its image of a contact is made."""
    optics = shipped.calibrated
    assert optics is not None

    def changed(shadows: tuple[Shadow, ...] = optics.shadows, **changes: object) -> Sensor:
        return shipped.model_copy(update={"calibrated": optics.model_copy(update={"shadows": shadows}), **changes})

    mean = tuple(polynomial_background(shipped, optics.background).mean(axis=(0, 1)).tolist())
    constant = shipped.model_copy(update={"calibrated": optics.model_copy(update={"background": (mean,)})})
    lamps = changed(calibrated=None, lights=load_sensor("gel_16mm").lights, membrane=0.0)
    on_photograph = added(untouched)
    yield "as shipped, on the untouched photograph", shipped, on_photograph
    yield "`membrane: 0`", changed(membrane=0.0), on_photograph
    if optics.shadows:
        yield "`shadows: []`", changed(shadows=()), on_photograph
        yield "`shadows: []`, `membrane: 0`", changed(shadows=(), membrane=0.0), on_photograph
    yield "`lights` of `gel_16mm` (equations 1 to 5), `membrane: 0`", lamps, _lit(untouched)
    yield "`background`: the shipped polynomial", shipped, _own
    yield "`background`: one colour", constant, _own
    yield f"`background`: the shipped polynomial, `noise: {NOISE:.0f}`", changed(noise=NOISE), _own


def _own(one: Photograph, sensor: Sensor) -> NDArray[np.uint8]:
    return tactile_image(sensor.w - ball_impression(sensor, one.contact, BALL), sensor, np.random.default_rng(0))


def _lit(untouched: NDArray[np.uint8]) -> Model:
    """How lamps change the image of a sensor that nothing touches, added to the untouched photograph."""

    def image(one: Photograph, sensor: Sensor) -> NDArray[np.uint8]:
        change = _own(one, sensor).astype(int) - untouched_image(sensor)
        return np.clip(untouched + change, 0, 255).astype(np.uint8)

    return image
