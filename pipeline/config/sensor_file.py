"""Sensor files: the YAML descriptions of tactile sensors."""

from __future__ import annotations

from pathlib import Path

from pipeline.config.description_file import description_path, read_description
from pipeline.kernels.touch.sensor import Sensor


def load_sensor(name: str | Path) -> Sensor:
    """Read a sensor by the name of a shipped sensor or by path; an `InvalidInput` names the file and what is wrong with it."""
    return read_description("sensor", description_path("sensor", name), Sensor)
