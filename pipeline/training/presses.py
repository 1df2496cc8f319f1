"""What networks that read photographs learn from: presses of one sensor. Declared without torch, as stages are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows, sensor_of
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.storage import Location

ARRAYS = ("press_image", "press_indentation", "press_contact", "press_untouched")  # arrays that are read of each object


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

    def name(self, item: int) -> str:
        """Name a press."""
        return self.names[item]


def stored_presses(data: Location, split: str, *, cache_megabytes: float = CACHE_MEGABYTES) -> Presses:
    """Open the presses of a split of a data directory."""
    rows = ObjectRows(data, ARRAYS, split, cache_megabytes=cache_megabytes)
    names = [f"{object_id} press {press}" for object_id in rows.object_ids for press in range(rows.size("press_image", "press"))]
    untouched = rows.read("press_untouched", rows.object_ids[0])
    return Presses(sensor_of(rows.collections["presses"].first), untouched, names, partial(_read_press, rows))


def _read_press(rows: ObjectRows, item: int) -> SimulatedPress:
    number, press = divmod(item, rows.size("press_image", "press"))
    return SimulatedPress(*(rows.read(array, rows.object_ids[number], press) for array in ARRAYS[:3]))
