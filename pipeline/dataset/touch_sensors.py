"""The sensors of a dataset's touches, as the root of its touch artifact describes them."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.sensor import Sensor

_SENSORS = TypeAdapter(Annotated[tuple[Sensor, ...], Field(min_length=1)])


def touch_sensors(attributes: Mapping[str, Any]) -> tuple[Sensor, ...]:
    """Read the sensor of each finger from the attributes of a `touch` group's root; raise a `ValidationError` if one is not described."""
    return _SENSORS.validate_python(attributes.get("sensors"))


def touch_sensor(attributes: Mapping[str, Any]) -> Sensor:
    """Read the sensor that all fingers wear; raise an `InvalidInput` if they wear different ones; other errors as `touch_sensors`."""
    first, *others = touch_sensors(attributes)
    if different := {sensor.name for sensor in others if sensor != first}:
        raise InvalidInput(
            f"the fingers wear different sensors ({', '.join(sorted(different | {first.name}))}); training on touches needs "
            "a hand that wears one: see `sensor` in its hand file"
        )
    return first
