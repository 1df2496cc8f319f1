"""The hand and sensors of stored grasps, as artifacts' attributes name them."""

from collections.abc import Mapping
from typing import Any

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import expanded
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor


def grasping_hand(attributes: Mapping[str, Mapping[str, Any]]) -> Hand:
    """Load the hand that made stored grasps.

    `attributes` are those of the roots of artifacts, by name: of `grasps`, and of `vision` where images were rendered.
    The file may have been moved since the grasps were made: `render-vision` took its path as a setting, and drew only
    this hand.
    """
    name = attributes.get("vision", attributes["grasps"])["settings"]["hand"]
    check_is_there(name, "put it there, or run render-vision again with its path")
    return load_hand(name)


def check_is_there(name: str, remedy: str) -> None:
    """Raise an `InvalidInput` with a remedy if the hand's file that a dataset records is not there.

    Its path may be of another folder.
    """
    path = expanded(name)
    if path.suffix in (".yaml", ".yml") and not path.is_file():
        where = "" if path.is_absolute() else ", a path from the folder where it was made: run this there, or"
        raise InvalidInput(f"the dataset records the hand {name!r}{where or ', which is not there:'} {remedy}")


def grasping_sensors(attributes: Mapping[str, Mapping[str, Any]]) -> tuple[Sensor, ...]:
    """Load the sensors of that hand; `attributes` as for `grasping_hand`."""
    return load_worn_sensors(sensor_names(grasping_hand(attributes), attributes["grasps"]["settings"].get("sensor")))
