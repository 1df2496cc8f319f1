"""Entries of observation files that name other files, or hold their arrays: images, masks, depths, sensors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationInfo, WithJsonSchema

from pipeline.formats.description_file import shipped_files
from pipeline.formats.image_file import read_depth, read_image, read_mask
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.sensor import Sensor


def _read(reader: Callable[[Path], Any], array_type: str) -> BeforeValidator:
    """Read a file that is named relative to the observation file; take an array as it is."""

    def validate(value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, str | Path):
            return reader(((info.context or {}).get("folder") or Path()) / value)
        if isinstance(value, np.ndarray) or value is None:
            return value
        raise ValueError(f"it must be the name of a file, or an array of {array_type}")

    return BeforeValidator(validate)


def _sensor(value: Any, info: ValidationInfo) -> Any:
    if not isinstance(value, str | Path):
        if isinstance(value, Sensor):
            return value
        raise ValueError("it must be the name of a shipped sensor, or of a sensor file")
    return load_sensor(value if str(value) in shipped_files("sensor") else ((info.context or {}).get("folder") or Path()) / value)


_FILE = WithJsonSchema({"type": "file"})
Image = Annotated[NDArray[np.uint8], _read(read_image, "uint8 (rows, cols, 3)"), _FILE]
Mask = Annotated[NDArray[np.bool_], _read(read_mask, "bool (rows, cols)"), _FILE]
Depth = Annotated[NDArray[Any], _read(read_depth, "uint16 or float32 (rows, cols)"), _FILE]
SensorName = Annotated[Sensor, BeforeValidator(_sensor), WithJsonSchema({"type": "name"})]


def check_array(name: str, array: Any, dtype: Any, dims: int) -> None:
    """Raise a `ValueError` if an array has another type, another number of dimensions, not three colours, or nothing in it."""
    if array.dtype != dtype or array.ndim != dims or (dims == 3 and array.shape[2] != 3) or not array.size:
        raise ValueError(f"{name} is {array.dtype} {array.shape}; it must be {np.dtype(dtype)} (rows, cols{', 3' * (dims == 3)})")


def size_text(array: NDArray[Any]) -> str:
    """Write columns x rows, for messages."""
    return f"{array.shape[1]} x {array.shape[0]}"
