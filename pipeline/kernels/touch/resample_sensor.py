"""Sensors with other numbers of pixels."""

import io
from typing import Any

import numpy as np
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.sensor import MAX_PIXELS_PER_SIDE, Sensor


def resample(sensor: Sensor, rows: int, cols: int) -> Sensor:
    """Change a sensor's number of pixels; its gel, its optics, its noise per pixel and the view of its background stay.

    A photograph of its background is resized with it: averaged where pixels become larger, else interpolated.
    """
    if not all(isinstance(count, int | np.integer) and 2 <= count <= MAX_PIXELS_PER_SIDE for count in (rows, cols)):
        raise InvalidInput(f"a sensor has from 2 to {MAX_PIXELS_PER_SIDE} rows and columns of pixels; these are {rows} x {cols}")
    if (rows, cols) == sensor.shape:
        return sensor
    changes: dict[str, Any] = {"rows": int(rows), "cols": int(cols)}
    if sensor.photograph is not None:
        photograph = Image.open(io.BytesIO(sensor.photograph)).convert("RGB")
        with io.BytesIO() as file:
            photograph.resize((cols, rows), Image.Resampling.BILINEAR).save(file, "PNG")  # its support widens where it averages
            changes["photograph"] = file.getvalue()
    return sensor.model_copy(update=changes)


def resample_longer_side(sensor: Sensor, pixels: int) -> Sensor:
    """Give a sensor square pixels, `pixels` of them along its longer side; otherwise as `resample`."""
    pitch = max(sensor.width, sensor.height) / pixels
    return resample(sensor, *(max(2, round(side / pitch)) for side in (sensor.height, sensor.width)))
