"""The sensors of a dataset's touches, as the root of its touch artifact describes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.sensor import Sensor


def touch_sensors(attributes: Mapping[str, Any]) -> tuple[Sensor, ...]:
    """Read the sensors that the fingers wear.

    Parameters
    ----------
    attributes
        Of the root of a `touch` group.

    Returns
    -------
    One per finger, or one alone where all wear the same.

    Raises
    ------
    ValidationError
        Nothing, or no sensor, is described.
    """
    said = attributes.get("sensor")
    return tuple(Sensor.model_validate(one) for one in (said if isinstance(said, list) and said else [said]))


def touch_sensor(attributes: Mapping[str, Any]) -> Sensor:
    """Read the sensor that all fingers wear; an `InvalidInput` where they wear different ones, otherwise as `touch_sensors`."""
    first, *others = touch_sensors(attributes)
    if different := {sensor.name for sensor in others if sensor != first}:
        raise InvalidInput(
            f"the fingers wear different sensors ({', '.join(sorted(different | {first.name}))}); what learns from touches needs "
            "a hand that wears one: see `sensor` in its hand file"
        )
    return first
