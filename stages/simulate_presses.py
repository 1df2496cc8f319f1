"""`simulate-presses`: the images of random shapes, and of patches of each object, that are pressed into a gel without a hand."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from pipeline.config.settings import ObjectSettings, defining, described_by
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Unit
from pipeline.entries import Range
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor, sensor_files
from pipeline.kernels.touch.depth_maps import normal_force, press_gel, quantise_depth, scaled_gel
from pipeline.kernels.touch.elastic_contact import check_layer
from pipeline.kernels.touch.press_shapes import (
    SHAPES,
    PressRanges,
    Relief,
    draw_patch,
    draw_shape,
    first_that_fits,
    known_shape,
    press_drawn,
)
from pipeline.kernels.touch.ray_depth import box_faces
from pipeline.kernels.touch.sensor import MAX_PIXELS_PER_SIDE, Sensor, resample_longer_side
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.presses import PRESSED, PRESSES
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


class PressSettings(GelSettings):
    """The number of presses, and variants of the gel."""

    presses: int = defining(72, "per object: 1800 for 25 objects, enough for a small network", ge=1, le=10_000)
    gel: Positives | None = defining(
        None, "least and greatest factor of the membrane's width, or an elastic gel's thickness, per press; null: 1"
    )


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


class SimulatePresses(PressingStage):
    """Press random shapes, and patches of each object, into a sensor's gel."""

    name = "simulate-presses"
    summary = "Press random shapes, and patches of every object, into a gel without a hand: for networks that read photographs."
    output = PRESSES
    settings_type = PressSettings

    def check_inputs(self, settings: PressSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Check that the gel is thicker than the deepest press and the cells of its contact, and that it has what `gel` scales."""
        sensor = pressed_sensor(settings)
        if settings.gel is not None and sensor.gel is None and sensor.membrane == 0:
            raise InvalidInput(f"gel is {list(settings.gel)}, but {sensor.name} has neither membrane nor gel to scale; unset gel")
        if settings.gel is not None and sensor.gel is not None:
            check_layer(scaled_gel(sensor, settings.gel[0]))

    def constants(self, settings: PressSettings) -> Row:
        """Render the sensor with nothing in its gel."""
        return {"press_untouched": untouched_image(pressed_sensor(settings))}

    def cost(self, settings: PressSettings) -> Cost:
        share = ((settings.pixels or 640) / 160) ** 2 * settings.presses
        return Cost(seconds=0.006 * share, kilobytes=60 * share)

    def count(self, settings: PressSettings) -> int:
        return settings.presses

    def draw(self, draw: Callable[..., Relief], sensor: Sensor, settings: PressSettings, rng: np.random.Generator) -> Row:
        """Compute the arrays of one press, from the depth as it is stored."""
        press = first_that_fits(press_drawn, draw, sensor, rng, PressRanges(settings.size, settings.depth))
        if settings.gel is not None:
            sensor = scaled_gel(sensor, rng.uniform(*settings.gel))
        depth = quantise_depth(press.depth, sensor, gel_bits=GEL_BITS, far_bits=FAR_BITS)
        gel = press_gel(depth, sensor)
        row: Row = {
            "press_shape": np.array(PRESSED.index(press.shape), np.uint8),
            "press_depth": depth,
            "press_indentation": gel.indentation.astype(np.float32),
            "press_contact": gel.contact,
            "press_image": render_gel(gel.indentation, sensor, rng),
        }
        if gel.pressure is not None:
            row |= {
                "press_pressure": gel.pressure.astype(np.float32),
                "press_force": np.array(normal_force(gel.pressure, sensor), np.float32),
            }
        return row


def pressed_sensor(settings: GelSettings) -> Sensor:
    """Load the sensor, with as many pixels as the settings say, and check that its gel is thicker than the deepest press."""
    sensor = load_sensor(settings.sensor)
    if settings.depth[1] >= (thickness := min(sensor.w, sensor.layer_thickness)):
        raise InvalidInput(f"depth goes to {settings.depth[1]} m, the gel of {sensor.name} is {thickness} m thick; press less deep")
    return sensor if settings.pixels is None else resample_longer_side(sensor, settings.pixels)
