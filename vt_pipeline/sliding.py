"""Touches over time: a sensor that presses, slides, twists, rolls and lifts off; and the dots printed on its gel."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.elastic_contact import check_layer
from pipeline.kernels.touch.markers import MarkerGrid, dot_displacement, draw_dots
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import MAX_FRICTION, Sensor, sensor_differences
from pipeline.kernels.touch.sliding import SlideStep, known_friction, slide_gel
from pipeline.kernels.touch.tactile_image import render_gel
from vt_pipeline.objects import Source, TouchObject, as_object
from vt_pipeline.touching import Touch, as_poses, as_rng, as_sensor

DOT_RADIUS = 3e-4  # m, of dots whose sensor has no `markers`


@dataclass(frozen=True, eq=False, repr=False)
class SlidingTouch(SlideStep, Touch):
    """Hold one step of a slide: a `Touch`, and what friction does to its gel.

    Components are along x and y of the sensor frame; forces are the object's on the gel.

    Attributes
    ----------
    gel, state
        The pressed gel (indentation, pressure, contact), and its `FrictionState`, from which the next step starts.
    """


def slide(
    object_: TouchObject | Source,
    sensor: Sensor | str | Path,
    poses: np.ndarray,
    *,
    friction: float | None = None,
    after: SlidingTouch | None = None,
    rng: np.random.Generator | None = None,
) -> Iterator[SlidingTouch]:
    """Move a sensor with an elastic gel along a path over an object: press, slide, twist, roll, lift off.

    Parameters
    ----------
    object_, sensor
        As in `touch`.
    poses
        (N, 4, 4) sensor frame to object frame, m, one after the other; the first touches nothing. What moves within a step counts as
        moved in contact: take short steps where a touch begins.
    friction
        Coefficient between gel and object; by default that of the sensor's file.
    after
        A step from which the path goes on, such as the last of another slide; the first pose may touch then.
    rng
        Draws the pixel noise of a sensor that has some; None for images without noise.

    Yields
    ------
    A touch per pose. The normal pressure is that of a touch: friction does not change it.

    Raises
    ------
    InvalidInput
        The sensor has no elastic gel, its friction is not known, or below 0; a pose is not a rigid motion; the path begins in contact; the
        object moves by more than the gel's thickness in a step that begins or ends in contact.

    Examples
    --------
    >>> path = np.tile(pose, (30, 1, 1))  # (4, 4) pose that touches nothing, here with +z along the object's -z
    >>> path[:, 2, 3] -= np.linspace(0, 1e-3, 30).clip(max=5e-4)
    >>> path[15:, 0, 3] += np.linspace(0, 4e-4, 15)
    >>> forces = [touch.shear_force for touch in slide("mug.glb", "gelsight_mini", path, friction=0.6)]
    """
    object_, sensor, rng = as_object(object_), as_sensor(sensor), as_rng(rng)
    check_layer(sensor)
    checked, coefficient = as_poses("poses", poses, several=True), _friction(friction, sensor)
    if not isinstance(after, SlidingTouch | None):
        raise TypeError(f"after is a step of slide; this is {type(after).__name__}")
    if after is not None and after.sensor != sensor:
        entries = ", ".join(sensor_differences(after.sensor, sensor, but_for={}))
        raise InvalidInput(f"the step to go on from is of {after.sensor}, this is {sensor}, another {entries}: give both the same sensor")
    steps = _steps(object_, sensor, checked, coefficient, after, rng)
    return chain(list(islice(steps, 1)), steps)  # what is wrong with the first pose is said at once


def _steps(
    object_: TouchObject,
    sensor: Sensor,
    poses: NDArray[np.float64],
    friction: float,
    after: SlidingTouch | None,
    rng: np.random.Generator | None,
) -> Iterator[SlidingTouch]:
    views = ((ray_depth(object_.faces, pose, sensor).astype(np.float32), pose) for pose in poses)
    for step in slide_gel(views, sensor, friction, after):
        yield SlidingTouch(sensor, step.pose, step.depth, render_gel(step.gel.indentation, sensor, rng), step.gel, step.state)


def _friction(given: float | None, sensor: Sensor) -> float:
    """Return the coefficient of friction: as given, or the sensor's."""
    friction = known_friction(sensor, given)
    try:
        value = float(friction)
    except (TypeError, ValueError) as error:
        raise TypeError(f"friction is a number; this is {type(friction).__name__}") from error
    if not 0 <= value <= MAX_FRICTION:
        raise InvalidInput(f"friction is {value}; a coefficient is from 0 to {MAX_FRICTION:g}, a rubber's 0.3 to 2")
    return value


class Markers(NamedTuple):
    """Hold the dots of a gel in one step of a slide.

    Attributes
    ----------
    positions, displacement
        (N, 2) m along x and y of the sensor frame: where the dots are at rest, and how far the gel's surface has moved them.
    image
        (rows, cols, 3) uint8: that of the step, with the dots, moved and stretched.
    """

    positions: NDArray[np.float64]
    displacement: NDArray[np.float64]
    image: NDArray[np.uint8]


def markers(touch: SlidingTouch, dots: Any = None) -> Markers:
    """Move the dots that are printed on a sensor's gel, as its surface moves.

    Parameters
    ----------
    touch
        A step of `slide`.
    dots
        (N, 2) positions of the dots at rest, m along x and y from the middle of the gel; by default the grid of the sensor's `markers`,
        which also gives their radius and colour: 0.3 mm and black if the sensor has none.

    Returns
    -------
    Displacements, and an image with the dots.

    Raises
    ------
    InvalidInput
        A dot lies outside the gel, or the sensor has no markers and no dots are given.
    """
    if not isinstance(touch, SlidingTouch):
        raise TypeError(f"markers are moved by a step of slide; this is {type(touch).__name__}")
    sensor = touch.sensor
    if dots is None and sensor.markers is None:
        raise InvalidInput(f"sensor {sensor.name} has no markers: give dots, (N, 2) in m, or add `markers: {{rows: 7, …}}` to its file")
    grid = sensor.markers or MarkerGrid(rows=1, cols=1, radius=DOT_RADIUS)
    positions = grid.positions(sensor.width, sensor.height) if dots is None else _as_dots(dots, sensor)
    displacement, image = dot_displacement(positions, touch.displacement, sensor.pitch), touch.image.copy()
    draw_dots(image, touch.displacement, sensor.pitch, positions, grid.radius, grid.colour)
    return Markers(positions, displacement, image)


def _as_dots(dots: Any, sensor: Sensor) -> NDArray[np.float64]:
    """Return positions of dots as an array (N, 2); an `InvalidInput` names one that lies outside the gel."""
    try:
        positions = np.array(dots, np.float64).reshape(len(dots), 2)
    except (TypeError, ValueError) as error:
        raise TypeError(f"dots are positions (N, 2), m, which this {type(dots).__name__} does not hold") from error
    for number in np.flatnonzero(~(np.abs(positions) <= (sensor.width / 2, sensor.height / 2)).all(axis=1))[:1]:  # NaN is outside
        raise InvalidInput(
            f"dot {number} is at {positions[number].tolist()} m, outside the gel of sensor {sensor.name}, which spans "
            f"±{sensor.width / 2:g} m along x and ±{sensor.height / 2:g} m along y; move or remove the dot"
        )
    return positions
