"""`simulate-presses`: the images of random shapes, and of patches of each object, that are pressed into a gel without a hand."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pipeline.config.settings import defining
from pipeline.engine.stage import Cost
from pipeline.errors import InvalidInput
from pipeline.kernels.touch.depth_maps import normal_force, press_gel, quantise_depth, scaled_gel
from pipeline.kernels.touch.elastic_contact import check_layer
from pipeline.kernels.touch.press_shapes import PressRanges, Relief, first_that_fits, press_drawn
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.store.rows import Row
from schemas.presses import PRESSED, PRESSES
from stages.pressing_stage import FAR_BITS, GEL_BITS, GelSettings, Positives, PressingStage, pressed_sensor


class PressSettings(GelSettings):
    """The number of presses, and variants of the gel."""

    presses: int = defining(72, "per object: 1800 for 25 objects, enough for a small network", ge=1, le=10_000)
    gel: Positives | None = defining(
        None, "least and greatest factor of the membrane's width, or an elastic gel's thickness, per press; null: 1"
    )


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
