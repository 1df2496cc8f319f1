"""What networks that read photographs learn from: presses, or steps of slides, of one sensor. Declared without torch, as stages are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows, sensor_of
from pipeline.kernels.touch.depth_maps import press_gel
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.storage import Location

ARRAYS = ("press_image", "press_indentation", "press_contact", "press_untouched")  # arrays that are read of each object
SLIDE_ARRAYS = tuple(f"slide_{name}" for name in ("tactile_image", "depth", "shear", "slip", "force", "untouched", "settled"))  # or these


class Motion(NamedTuple):
    """What a step of a slide adds to a press."""

    before: NDArray[np.uint8]  # (rows, cols, 3) tactile image of the step before
    shear: NDArray[np.float32]  # (rows, cols, 2) m
    slip: NDArray[np.float32]  # (rows, cols, 2) m
    force: NDArray[np.float32]  # (3,) N


class SimulatedPress(NamedTuple):
    """A press, or a step of a slide."""

    image: NDArray[np.uint8]  # (rows, cols, 3) tactile image
    indentation: NDArray[np.float32]  # (rows, cols) m, of the gel
    contact: NDArray[np.bool_]  # (rows, cols)
    motion: Motion | None = None


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
    image, indentation, contact = (rows.read(array, rows.object_ids[number], press) for array in ARRAYS[:3])
    return SimulatedPress(image, indentation, contact)


def stored_slides(data: Location, split: str, *, cache_megabytes: float = CACHE_MEGABYTES) -> Presses:
    """Open the steps of the slides of a split of a data directory, but for those whose shear did not settle."""
    rows = ObjectRows(data, SLIDE_ARRAYS, split, cache_megabytes=cache_megabytes)
    steps = [(name, slide, step) for name in rows.object_ids for slide, step in np.argwhere(rows.read("slide_settled", name)).tolist()]
    names = [f"{object_id} slide {slide} step {step}" for object_id, slide, step in steps]
    untouched, sensor = rows.read("slide_untouched", rows.object_ids[0]), sensor_of(rows.collections["slides"].first)
    return Presses(sensor, untouched, names, partial(_read_slide, rows, sensor, steps))


def _read_slide(rows: ObjectRows, sensor: Sensor, steps: Sequence[tuple[str, int, int]], item: int) -> SimulatedPress:
    object_id, slide, step = steps[item]
    image, depth, shear, slip, force = (rows.read(array, object_id, slide) for array in SLIDE_ARRAYS[:5])
    gel = press_gel(depth[step], sensor)
    motion = Motion(image[max(step - 1, 0)], shear[step], slip[step], force[step])
    return SimulatedPress(image[step], gel.indentation.astype(np.float32), gel.contact, motion)
