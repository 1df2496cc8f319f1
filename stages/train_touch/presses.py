"""The training data of a local network: presses of `simulate-presses`, or presses made here for a sensor without a dataset."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows
from pipeline.dataset.touch_sensors import touch_sensor
from pipeline.kernels.touch.press_shapes import random_press
from pipeline.kernels.touch.pressed_gel import press_gel, scaled_gel
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.rng import numpy_rng
from pipeline.store.storage import Location

ARRAYS = ("press_image", "press_indentation", "press_contact", "press_untouched")
"""Arrays that are read of each object."""


class SimulatedPress(NamedTuple):
    """A press."""

    image: NDArray[np.uint8]  # (rows, cols, 3) tactile image
    indentation: NDArray[np.float32]  # (rows, cols) m, of the gel
    contact: NDArray[np.bool_]  # (rows, cols)


class Presses(Protocol):
    """Presses of one sensor."""

    @property
    def sensor(self) -> Sensor:
        """Their sensor, with their pixels."""

    @property
    def untouched(self) -> NDArray[np.uint8]:
        """The image (rows, cols, 3) without a press."""

    def __len__(self) -> int:
        """Count the presses."""

    def read(self, item: int) -> SimulatedPress:
        """Read a press."""

    def describe(self, item: int) -> str:
        """Name a press."""


class StoredPresses:
    """The presses of a split of a data directory."""

    def __init__(self, data: Location, split: str, *, cache_megabytes: float = CACHE_MEGABYTES) -> None:
        self.rows = ObjectRows(data, ARRAYS, split, cache_megabytes=cache_megabytes)
        self.sensor = touch_sensor(self.rows.attributes("presses"))
        self.untouched = self.rows.read("press_untouched", self.rows.object_ids[0])
        self.presses_per_object = self.rows.size("press_image", "press")

    def __len__(self) -> int:
        return len(self.rows) * self.presses_per_object

    def read(self, item: int) -> SimulatedPress:
        """Read a press."""
        number, press = divmod(item, self.presses_per_object)
        image, indentation, contact = (self.rows.read(array, self.rows.object_ids[number], press) for array in ARRAYS[:3])
        return SimulatedPress(image, indentation, contact)

    def describe(self, item: int) -> str:
        """Name the object and the number of a press."""
        number, press = divmod(item, self.presses_per_object)
        return f"{self.rows.object_ids[number]} press {press}"


@dataclass(frozen=True, eq=False)
class RandomPresses:
    """Random shapes pressed into a sensor, in memory: for a sensor without a dataset."""

    sensor: Sensor
    untouched: NDArray[np.uint8]  # (rows, cols, 3)
    presses: list[SimulatedPress]

    def __len__(self) -> int:
        return len(self.presses)

    def read(self, item: int) -> SimulatedPress:
        """Return a press."""
        return self.presses[item]

    def describe(self, item: int) -> str:
        """Name a press."""
        return f"random press {item}"


def random_presses(
    sensor: Sensor,  # with as many pixels as the images shall have
    count: int,
    seed: int,  # of all draws
    *,
    gel: tuple[float, float],  # least and greatest factor of gel thickness or membrane width, drawn per press
) -> RandomPresses:
    """Press random shapes into a sensor."""
    presses = []
    for number in range(count):
        rng = numpy_rng(seed, "random-presses", number)
        press = random_press(sensor, rng)
        varied = scaled_gel(sensor, rng.uniform(*gel))
        state = press_gel(press.depth, varied)
        presses.append(SimulatedPress(render_gel(state.indentation, varied, rng), state.indentation.astype(np.float32), state.contact))
    return RandomPresses(sensor, untouched_image(sensor), presses)
