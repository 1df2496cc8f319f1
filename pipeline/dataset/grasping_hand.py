"""The hand and sensors of stored grasps, as artifacts' attributes name them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor


def grasping_hand(attributes: Mapping[str, Mapping[str, Any]]) -> Hand:
    """Load the hand that made stored grasps.

    Parameters
    ----------
    attributes
        Of the roots of artifacts, by name: of `grasps`, and of `vision` where images were rendered.

    Notes
    -----
    The file may have been moved since the grasps were made: `render-vision` took its path as a setting, and drew only this hand.

    Raises
    ------
    InvalidInput
        The hand's file is not there, or as `load_hand`.
    """
    name = attributes.get("vision", attributes["grasps"])["settings"]["hand"]
    check_is_there(name, "run this command there")
    return load_hand(name)


def check_is_there(name: str, remedy: str) -> None:
    """Raise an `InvalidInput` with a remedy if the file of a hand that stored grasps name is not there, perhaps in another folder."""
    if Path(name).suffix in (".yaml", ".yml") and not Path(name).expanduser().is_file():
        origin = "" if Path(name).expanduser().is_absolute() else ", a path from the folder where simulate-grasps ran"
        raise InvalidInput(f"the grasps record the hand {name!r}{origin}; there is no such file here: {remedy}")


def grasping_sensors(attributes: Mapping[str, Mapping[str, Any]]) -> tuple[Sensor, ...]:
    """Load the sensors of that hand; parameters as for `grasping_hand`."""
    return load_worn_sensors(sensor_names(grasping_hand(attributes), attributes["grasps"]["settings"].get("sensor")))
