"""The base of stages that press a gel without a hand: its settings, its sensor, and what is pressed."""

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from pipeline.config.settings import ObjectSettings, defining, described_by
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs, ObjectStage, Unit
from pipeline.entries import Range
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor, sensor_files
from pipeline.kernels.touch.press_shapes import SHAPES, PressRanges, Relief, draw_patch, draw_shape, known_shape
from pipeline.kernels.touch.ray_depth import box_faces
from pipeline.kernels.touch.sensor import MAX_PIXELS_PER_SIDE, Sensor, resample_longer_side
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.surfaces import SURFACES

GEL_BITS, FAR_BITS = 26, 18  # depths are stored in steps of 2^-26 m in the gel and of 2^-18 m beyond, as `simulate-touch` stores them


Positives = Range[Annotated[float, Field(gt=0, le=10)]]
DEFAULT = PressRanges()


class GelSettings(ObjectSettings):
    """The gel, and what is pressed into it without a hand."""

    sensor: Annotated[str, described_by("sensor")] = defining(
        "gelsight", "a calibrated one: photographs of your own sensor need the file of `calibrate-sensor`"
    )
    pixels: int | None = defining(
        160,
        "along the longer side, square ones: enough for what a gel shows, a sixteenth of a camera's bytes; null keeps the sensor's",
        ge=8,
        le=MAX_PIXELS_PER_SIDE,
    )
    patches: float = defining(0.2, "share of what is pressed that is a patch of the object itself; the rest are `shapes`", ge=0, le=1)
    shapes: tuple[Annotated[str, AfterValidator(known_shape)], ...] = defining(
        tuple(SHAPES), "all shapes: a network memorises a single one", min_length=1
    )
    size: Positives = defining(DEFAULT.size, "least and greatest radius of a shape, m: what fits on a gel of 2 cm")
    depth: Positives = defining(DEFAULT.depth, "least and greatest depth of the deepest point in the gel, m: what hands and people press")


class PressingStage(ObjectStage):
    """A stage that presses shapes and patches of each object into a gel without a hand."""

    def inputs(self, settings: GelSettings) -> tuple[Artifact, ...]:
        return (SURFACES,)

    def assets(self, settings: GelSettings) -> list[Path]:
        return sensor_files([settings.sensor])

    def attributes(self, settings: GelSettings) -> dict[str, Any]:
        """Describe the sensor with the pixels of the images, as `simulate-touch` does those of the fingers."""
        return {"sensors": [pressed_sensor(settings).model_dump(mode="json")]}

    @abstractmethod
    def count(self, settings: Any) -> int:
        """Return the number of presses or slides per object."""

    @abstractmethod
    def draw(self, draw: Callable[..., Relief], sensor: Sensor, settings: Any, rng: np.random.Generator) -> Row:
        """Press what `draw` draws, `draw_patch` of the object or `draw_shape`, and compute its arrays."""

    def process(self, unit: Unit, inputs: Inputs, settings: GelSettings) -> Row:
        view, sensor, rows = inputs["surfaces"], pressed_sensor(settings), []
        patch = partial(draw_patch, box_faces(read_mesh(view).triangles), view["points"], view["normals"])
        shape = partial(draw_shape, shapes=settings.shapes)
        for number in range(self.count(settings)):
            rng = unit.rng(self.name, number)
            rows.append(self.draw(patch if rng.random() < settings.patches else shape, sensor, settings, rng))
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def pressed_sensor(settings: GelSettings) -> Sensor:
    """Load the sensor, with as many pixels as the settings say, and check that its gel is thicker than the deepest press."""
    sensor = load_sensor(settings.sensor)
    if settings.depth[1] >= (thickness := min(sensor.w, sensor.layer_thickness)):
        raise InvalidInput(f"depth goes to {settings.depth[1]} m, the gel of {sensor.name} is {thickness} m thick; press less deep")
    return sensor if settings.pixels is None else resample_longer_side(sensor, settings.pixels)
