"""Sensor files: the YAML descriptions of tactile sensors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path, read_description
from pipeline.formats.file_content import expanded
from pipeline.formats.image_file import read_image
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor, resample


def load_sensor(name: str | Path, *, shape: tuple[int, int] | None = None) -> Sensor:
    """Read a sensor by the name of a shipped one or by the path of its file, perhaps with other rows and columns (`resample`)."""
    if shape is not None and np.shape(shape) != (2,):
        raise InvalidInput(f"the shape of a sensor's image is (rows, cols); this is {shape!r}")
    path = description_path("sensor", name)
    sensor = read_description("sensor", path, Sensor)
    if file := photograph_file(path, sensor):
        image = read_image(file)
        if image.shape[:2] != sensor.shape:
            raise InvalidInput(
                f"{file} has {image.shape[0]} x {image.shape[1]} pixels, {path} says {sensor.rows} x {sensor.cols}; make them agree"
            )
        sensor = sensor.model_copy(update={"photograph": image.tobytes()})
    return sensor if shape is None else resample(sensor, *shape)


def photograph_file(path: Path, sensor: Sensor) -> Path | None:
    """Find the photograph that a sensor file names as its background; None if it names none."""
    background = sensor.calibrated.background if sensor.calibrated else None
    return path.parent / background if isinstance(background, str) else None


def sensor_names(hand: Hand, override: str | None = None) -> tuple[str, ...]:
    """Name the sensor at each mount, the hand file's, or `override` on all: a shipped one, or an absolute path."""
    names = [override or mount.sensor for mount in hand.sensors]
    return tuple(name if (path := expanded(name)).suffix not in (".yaml", ".yml") else str(path.absolute()) for name in names)


def sensor_files(names: Sequence[str]) -> list[Path]:
    """List the files that describe sensors, each once."""
    files: list[Path] = []
    for name in dict.fromkeys(names):
        path = description_path("sensor", name)
        photograph = photograph_file(path, read_description("sensor", path, Sensor))
        files += [path] if photograph is None else [path, photograph]
    return files


def load_worn_sensors(names: Sequence[str]) -> tuple[Sensor, ...]:
    """Read the sensors of a hand, mount by mount.

    One array holds the images of all, so rows and columns must agree, and all or none must have an elastic gel.
    """
    sensors = {name: load_sensor(name) for name in dict.fromkeys(names)}
    if len({sensor.shape for sensor in sensors.values()}) > 1:
        listed = ", ".join(f"{name} has {sensor.rows} x {sensor.cols}" for name, sensor in sensors.items())
        raise InvalidInput(f"the sensors of one hand need the same rows and columns of pixels, but {listed}; change them in copies")
    if len({sensor.gel is None for sensor in sensors.values()}) > 1:
        soft, hard = (", ".join(name for name, sensor in sensors.items() if (sensor.gel is None) == rigid) for rigid in (False, True))
        raise InvalidInput(f"an elastic gel gives pressure and force, of {soft} but not of {hard}; give all sensors a `gel`, or none")
    return tuple(map(sensors.__getitem__, names))
