"""An elastic gel over time: what an object that is pressed, slid, twisted and lifted off does to it, step by step."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from pipeline.console import pluralise
from pipeline.errors import InvalidInput, unknown_name
from pipeline.kernels.touch.depth_maps import normal_force, press_gel
from pipeline.kernels.touch.elastic_contact import PressedGel
from pipeline.kernels.touch.friction import (
    FrictionState,
    drag_gel,
    force_and_torque,
    gel_at_rest,
    object_motion,
    on_pixels,
    surface_displacement,
    surface_traction,
)
from pipeline.kernels.touch.markers import dot_displacement, draw_dots
from pipeline.kernels.touch.sensor import MM, Sensor
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from schemas.sequences import ALWAYS

SHEAR_STEPS = 2.0**22  # per m: displacements are stored to 0.12 µm, as far as the solver settles, in half the bytes
DIGITS = 2.0**12  # binary ones of pressures, tractions and slip, likewise


@dataclass(frozen=True, eq=False, repr=False)
class SlideStep:
    """The gel in one step of a slide. Components are along x and y of the sensor frame; forces are the object's on the gel."""

    sensor: Sensor
    pose: NDArray[np.float64]  # (4, 4) sensor frame to object frame, m
    depth: NDArray[np.float32]  # (rows, cols) m
    gel: PressedGel
    state: FrictionState  # from which the next step starts

    @property
    def settled(self) -> bool:
        """Whether the solver reached its tolerance in this step; if not, do not rely on its shear."""
        return self.state.settled

    @cached_property
    def displacement(self) -> NDArray[np.float64]:
        """(rows, cols, 2) displacement of the gel's surface from its rest, m."""
        return surface_displacement(self.state, self.sensor)

    @cached_property
    def traction(self) -> NDArray[np.float64]:
        """(rows, cols, 2) tangential traction, Pa; at most friction times `pressure`."""
        return surface_traction(self.state, self.gel, self.sensor)

    @cached_property
    def slip(self) -> NDArray[np.float64]:
        """(rows, cols, 2): how far the object slid over the gel in this step, m; 0 where it sticks and outside the contact."""
        return on_pixels(self.state.slip, self.sensor) * self.gel.contact[..., None]

    @property
    def slips(self) -> NDArray[np.bool_]:
        """(rows, cols): where the object slips; elsewhere in `contact` it sticks."""
        return np.asarray(self.slip.any(axis=-1))

    @property
    def slip_share(self) -> float:
        """Share of the contact that slips; 0 without contact. A mere press slips a little at the rim."""
        return float(self.slips.sum() / max(self.gel.contact.sum(), 1))

    @property
    def gross_slip(self) -> bool:
        """Whether the object touches and sticks nowhere."""
        return bool(self.gel.contact.any() and (self.slips == self.gel.contact).all())

    @property
    def shear_force(self) -> NDArray[np.float64]:
        """(2,) tangential force, N; `force` is the normal one."""
        return force_and_torque(self.traction, self.sensor)[0]

    @property
    def torque(self) -> float:
        """Torque of the tractions about the sensor's axis, +z, N·m."""
        return force_and_torque(self.traction, self.sensor)[1]


def slide_gel(
    views: Iterable[tuple[NDArray[np.float32], NDArray[np.float64]]],  # depth (rows, cols), m; pose (4, 4), sensor frame to object frame, m
    sensor: Sensor,  # with an elastic gel
    friction: float,  # coefficient
    after: SlideStep | None = None,  # from which the path goes on; by default the gel is at rest, and the first view without contact
) -> Iterator[SlideStep]:
    """Move an object over a gel, one step per view; a path that cannot be followed is `InvalidInput`."""
    state, before = (gel_at_rest(sensor), None) if after is None else (after.state, after.pose)
    for number, (depth, pose) in enumerate(views):
        gel = press_gel(depth, sensor)
        if before is None and gel.contact.any():
            raise InvalidInput(
                f"poses[0] is in contact, {MM * gel.indentation.max():.3g} mm deep, and the shear of the gel is unknown: start the path "
                "without contact, or continue from a step of another slide with `after`"
            )
        motion = object_motion(depth, pose if before is None else before, pose, sensor)
        try:
            state = drag_gel(gel, motion, state, sensor, friction)
        except InvalidInput as error:
            raise InvalidInput(f"poses[{number}]: {error}") from error
        before = pose
        yield SlideStep(sensor, pose, depth, gel, state)


def known_friction(sensor: Sensor, given: float | None = None, *, fallback: float | None = None) -> float:
    """Return the coefficient of friction as given, or the sensor's, or else the fallback.

    Raise an `InvalidInput` if the sensor has no elastic gel, or none is known.
    """
    if sensor.gel is None:
        raise InvalidInput(f"sensor {sensor.name} has no elastic gel, which slides and lifts need; add `gel: {{modulus: …}}` to its file")
    friction = next((value for value in (given, sensor.gel.friction, fallback) if value is not None), None)
    if friction is None:
        raise InvalidInput(f"the friction of sensor {sensor.name} is not known: give friction, or add `gel: {{friction: …}}` to its file")
    return friction


def measure_steps(
    steps: Iterable[SlideStep],
    quantities: Collection[str],  # names from `QUANTITIES`
    rng: np.random.Generator | None = None,  # draws the pixel noise of a sensor that has some
) -> dict[str, np.ndarray]:  # (steps, …) each
    """Compute quantities of every step as datasets store them (`schemas.sequences`); others cost nothing."""
    rows = [{name: QUANTITIES[name](step, rng) for name in quantities} for step in steps]
    return {name: np.stack([row[name] for row in rows]) for name in quantities}


def unsettled_remarks(settled: NDArray[np.bool_], array: str) -> Iterator[str]:
    """Count the steps that did not settle, of an array of this name."""
    if not settled.all():
        yield f"{(~settled).sum()} of {pluralise(settled.size, 'step')} did not settle ({array}): do not rely on their shear"


def resting_image(sensor: Sensor) -> NDArray[np.uint8]:
    """Render a sensor that nothing touches, with its markers."""
    return _with_markers(untouched_image(sensor), sensor, np.zeros((*sensor.shape, 2)))


def _with_markers(image: NDArray[np.uint8], sensor: Sensor, displacement: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Draw a sensor's markers, if it has some, where the gel's surface has carried them."""
    if (dots := sensor.markers) is not None:
        draw_dots(image, displacement, sensor.pitch, dots.positions(sensor.width, sensor.height), dots.radius, dots.colour)
    return image


def _image(step: SlideStep, rng: np.random.Generator | None) -> NDArray[np.uint8]:
    image = render_gel(step.gel.indentation, step.sensor, rng)
    return _with_markers(image, step.sensor, step.displacement) if step.sensor.markers else image


def _dots(step: SlideStep) -> NDArray[np.float32]:
    sensor = step.sensor
    if sensor.markers is None:
        raise ValueError(f"sensor {sensor.name!r} has no markers")
    positions = sensor.markers.positions(sensor.width, sensor.height)
    return dot_displacement(positions, step.displacement, sensor.pitch).astype(np.float32)


def _few_digits(values: NDArray[np.float64]) -> NDArray[np.float32]:
    share, exponent = np.frexp(values)
    return np.ldexp(np.rint(share * DIGITS) / DIGITS, exponent).astype(np.float32)


def _force(step: SlideStep) -> NDArray[np.float32]:
    return np.array([*step.shear_force, -normal_force(np.asarray(step.gel.pressure), step.sensor)], np.float32)


QUANTITIES: Mapping[str, Callable[[SlideStep, np.random.Generator | None], np.ndarray]] = {
    "pose": lambda step, _: step.pose,
    "depth": lambda step, _: step.depth,
    "tactile_image": _image,
    "pressure": lambda step, _: _few_digits(np.asarray(step.gel.pressure)),
    "shear": lambda step, _: (np.rint(step.displacement * SHEAR_STEPS) / SHEAR_STEPS).astype(np.float32),
    "traction": lambda step, _: _few_digits(step.traction),
    "slip": lambda step, _: _few_digits(step.slip),
    "slip_share": lambda step, _: np.array(step.slip_share, np.float32),
    "gross_slip": lambda step, _: np.array(step.gross_slip),
    "force": lambda step, _: _force(step),
    "torque": lambda step, _: np.array(step.torque, np.float32),
    "marker_displacement": lambda step, _: _dots(step),
    "settled": lambda step, _: np.array(step.settled),
}
"""What a step tells, by the name under which datasets store it."""

CHOSEN = tuple(name for name in QUANTITIES if name not in ALWAYS)
"""What settings choose from."""


def _known(name: str) -> str:
    if name not in CHOSEN:
        raise InvalidInput(unknown_name("array", name, CHOSEN))
    return name


Quantity = Annotated[str, AfterValidator(_known)]


def stored_quantities(store: Sequence[str] | None, sensors: Sequence[Sensor]) -> tuple[str, ...]:
    """Name the quantities to compute of each step, but its time; None stands for all but traction, and markers' where there are some."""
    bare = next((sensor.name for sensor in sensors if sensor.markers is None), None)
    if store and "marker_displacement" in store and bare is not None:
        raise InvalidInput(f"store names marker_displacement, but {bare} has none; add `markers: {{rows: 7, …}}` to its file")
    skipped = {"traction"} if bare is None else {"traction", "marker_displacement"}
    return ("pose", "settled", *([name for name in CHOSEN if name not in skipped] if store is None else store))
