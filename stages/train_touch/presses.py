"""The training data of a local network: presses of `simulate-presses`, or presses made here for a sensor without a dataset."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows, touch_sensor
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


@dataclass(frozen=True, eq=False)
class Presses:
    """Presses of one sensor."""

    sensor: Sensor  # with their pixels
    untouched: NDArray[np.uint8]  # (rows, cols, 3) the image without a press
    names: Sequence[str]  # of the presses, in messages
    read: Callable[[int], SimulatedPress]  # a press, by number

    def __len__(self) -> int:
        return len(self.names)


def stored_presses(data: Location, split: str, *, cache_megabytes: float = CACHE_MEGABYTES) -> Presses:
    """Open the presses of a split of a data directory."""
    rows = ObjectRows(data, ARRAYS, split, cache_megabytes=cache_megabytes)
    per_object = rows.size("press_image", "press")
    names = [f"{object_id} press {press}" for object_id in rows.object_ids for press in range(per_object)]

    def read(item: int) -> SimulatedPress:
        number, press = divmod(item, per_object)
        return SimulatedPress(*(rows.read(array, rows.object_ids[number], press) for array in ARRAYS[:3]))

    return Presses(touch_sensor(rows.attributes("presses")), rows.read("press_untouched", rows.object_ids[0]), names, read)


def random_presses(
    sensor: Sensor,  # with as many pixels as the images shall have
    count: int,
    seed: int,  # of all draws
    *,
    gel: tuple[float, float],  # least and greatest factor of gel thickness or membrane width, drawn per press
) -> Presses:
    """Press random shapes into a sensor without a dataset; they stay in memory."""
    presses = []
    for number in range(count):
        rng = numpy_rng(seed, "random-presses", number)
        press = random_press(sensor, rng)
        varied = scaled_gel(sensor, rng.uniform(*gel))
        state = press_gel(press.depth, varied)
        presses.append(SimulatedPress(render_gel(state.indentation, varied, rng), state.indentation.astype(np.float32), state.contact))
    return Presses(sensor, untouched_image(sensor), [f"random press {number}" for number in range(count)], presses.__getitem__)
