"""`simulate-slides`: shapes, and patches of each object, that are pressed into a gel, slid, twisted and lifted off: shear, slip, forces."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from pipeline.config.settings import defining, setting
from pipeline.engine.stage import Cost
from pipeline.entries import Range
from pipeline.errors import InvalidInput
from pipeline.kernels.touch.depth_maps import quantise_depth
from pipeline.kernels.touch.elastic_contact import check_layer
from pipeline.kernels.touch.press_shapes import PressRanges, Relief, first_that_fits
from pipeline.kernels.touch.sensor import Friction, Sensor
from pipeline.kernels.touch.slide_paths import CLEARANCE, PathRanges, draw_path, follow_path
from pipeline.kernels.touch.sliding import (
    CHOSEN,
    Quantity,
    known_friction,
    measure_steps,
    resting_image,
    slide_gel,
    stored_quantities,
    unsettled_remarks,
)
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.presses import PRESSED
from schemas.sequences import ALWAYS
from schemas.slides import SLIDES
from stages.pressing_stage import FAR_BITS, GEL_BITS, GelSettings, Positives, PressingStage, pressed_sensor


class SlideSettings(GelSettings):
    """The paths, their friction, and what is stored of each step."""

    patches: float = defining(0.5, "share of the slides that are over patches of the object itself; the rest are over `shapes`", ge=0, le=1)
    slides: int = defining(4, "sequences per object: press, slide, twist, lift off", ge=1, le=10_000)
    steps: int = defining(32, "per sequence: 2 s at the default rate", ge=4, le=1000)
    rate: float = defining(16.0, "steps per second: a step moves by less than a contact's radius", gt=0, le=1e4)
    friction: Range[Friction] | None = defining((0.3, 1.2), "least and greatest coefficient, drawn per sequence: rubber's; null: sensor's")
    press_speed: Positives = defining((0.003, 0.006), "least and greatest speed of press and lift, m/s: either takes under half a second")
    slide_speed: Positives = defining((0.0005, 0.004), "least and greatest speed of the slide, m/s: from mostly sticking to gross slip")
    twist_speed: Positives = defining((0.1, 0.8), "least and greatest speed of the twist, rad/s, either way round")
    store: tuple[Quantity, ...] | None = setting(
        None,
        f"what is computed and stored of each step beside {', '.join(ALWAYS)}, from {', '.join(CHOSEN)}; null: all but traction, and "
        "marker_displacement where the sensor has markers",
    )


class SimulateSlides(PressingStage):
    """Press random shapes, and patches of each object, into a sensor's gel, slide and twist them, and lift off."""

    name = "simulate-slides"
    summary = "Slide random shapes, and patches of every object, over a gel: shear, slip, forces and markers over time."
    output = SLIDES
    settings_type = SlideSettings

    def check_inputs(self, settings: SlideSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Check that gel and friction are known, press and lift leave time to slide, and no step is longer than the gel is thick."""
        sensor = pressed_sensor(settings)
        check_layer(sensor)
        known_friction(sensor, settings.friction[0] if settings.friction else None)
        stored_quantities(settings.store, [sensor])
        slowest, quarter = (settings.depth[1] + CLEARANCE) / settings.press_speed[0], (settings.steps - 1) / settings.rate / 4
        if slowest > quarter:
            raise InvalidInput(
                f"a press of {settings.depth[1]} m at a press_speed of {settings.press_speed[0]} m/s takes {slowest:.3g} s, over a quarter "
                f"of {settings.steps} steps at {settings.rate:g} per second, {quarter:.3g} s: press faster or less deep, or take more steps"
            )
        speed = max(*settings.press_speed, *settings.slide_speed, settings.twist_speed[1] * math.hypot(sensor.width, sensor.height) / 2)
        step, thickness = speed / settings.rate, sensor.layer_thickness
        if step > thickness:
            raise InvalidInput(
                f"steps move by up to {step:.3g} m, more than the gel of {sensor.name} is thick, {thickness:.3g} m: "
                "lower press_speed, slide_speed or twist_speed, or raise rate"
            )

    def constants(self, settings: SlideSettings) -> Row:
        """Render the sensor with nothing in its gel, but with its markers."""
        return {"slide_untouched": resting_image(pressed_sensor(settings))}

    def describe_shard(self, settings: SlideSettings, shard: Shard) -> Iterator[str]:
        """Count the steps that did not settle."""
        yield from unsettled_remarks(shard.read("slide_settled")[shard.read("ok")], "slide_settled")

    def cost(self, settings: SlideSettings) -> Cost:
        share = ((settings.pixels or 640) / 160) ** 2 * settings.slides * settings.steps
        return Cost(seconds=0.025 * share, kilobytes=52 * share)

    def count(self, settings: SlideSettings) -> int:
        return settings.slides

    def draw(self, draw: Callable[..., Relief], sensor: Sensor, settings: SlideSettings, rng: np.random.Generator) -> Row:
        return first_that_fits(_slide, draw, sensor, settings, rng)


def _slide(draw: Callable[..., Relief], sensor: Sensor, settings: SlideSettings, rng: np.random.Generator) -> Row:
    """Draw a sequence, and compute its arrays from the depth as it is stored."""
    limits = PathRanges(settings.depth, settings.press_speed, settings.slide_speed, settings.twist_speed)
    path = draw_path(settings.steps, settings.rate, limits, rng)
    friction = np.float32(known_friction(sensor, None if settings.friction is None else rng.uniform(*settings.friction)))
    deepest = path.depth.max()
    relief = draw(sensor, rng, PressRanges(settings.size, (deepest, deepest)), path.motion)
    depths, poses = follow_path(relief, path, sensor)
    stored = quantise_depth(np.stack(depths), sensor, gel_bits=GEL_BITS, far_bits=FAR_BITS)
    steps = slide_gel(zip(stored, poses, strict=True), sensor, float(friction))
    measured = measure_steps(steps, stored_quantities(settings.store, [sensor]), rng) | {"time": path.time.astype(np.float32)}
    return {
        "slide_shape": np.array(PRESSED.index(relief.shape), np.uint8),
        "slide_scale": np.array(relief.scale, np.float32),
        "slide_friction": np.array(friction),
        **{f"slide_{name}": values for name, values in measured.items()},
    }
