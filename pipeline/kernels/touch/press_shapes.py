"""Shapes that are pressed into a gel without a hand: random ones to train on, patches of objects, and any relief at a given depth.

A relief is an array of heights along the sensor's -z, from an object towards the gel; -inf where the object has no surface. A sensor that
moves over an object meets a relief per step; a press is a path of one step.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.geometry.transforms import compose, length, pose_of, sin_cos, unit_vectors
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.ray_depth import BoxedFaces, ray_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres

WALLS = (3.0, 30.0)  # height over length of a solid's walls: nearly upright, so that they fall within a few pixels
ATTEMPTS = 20  # presses or slides that are drawn before a sensor counts as one that none of them fits
TILTED = 0.3  # share of the presses whose shape does not lie flat on the gel
AT_REST = np.eye(4)[None]  # the path of a press

T = TypeVar("T")


@dataclass(frozen=True)
class PressRanges:
    """Ranges from which random presses are drawn: least and greatest values."""

    size: tuple[float, float] = (0.0015, 0.008)  # radius of a shape, m
    depth: tuple[float, float] = (0.0001, 0.0012)  # of the deepest point in the gel, m
    tilt: float = math.radians(8)  # greatest angle by which a shape is tilted, rad
    middle: float = 0.5  # greatest distance of a shape's middle from the gel's along each axis, in sides of the gel
    scale: tuple[float, float] = (0.04, 0.5)  # of an object, of its own size: from whole toys to plain walls


class Press(NamedTuple):
    """A random press."""

    shape: str  # its name
    depth: Array  # (rows, cols) D, m, +inf where nothing is met


class Relief(NamedTuple):
    """A random shape, or a patch of an object, as a sensor meets it at each step of a path."""

    shape: str  # its name
    heights: Array  # (steps, rows, cols) towards the gel, m
    poses: Array  # (steps, 4, 4) sensor frame to that of the shape, or of the scaled object, where the sensor plane has height 0, m
    scale: float  # of the object
    depth: float  # to which it is pressed, m


def press_relief(
    relief: Array,  # (rows, cols) heights towards the gel, m; -inf where there is no surface
    sensor: Sensor,
    depth: float,  # of the deepest point in the gel, m, less than the gel's thickness there
) -> Array:  # (rows, cols) D from the sensor plane, m; +inf where nothing is met within the sensor's range
    """Press a relief into a gel; a constant added to the relief changes nothing."""
    return lower_sensor(relief, sensor, depth, least=0.0)[0]


def lower_sensor(
    relief: Array,  # as in `press_relief`
    sensor: Sensor,
    depth: float,
    *,
    least: float = -np.inf,  # depth, m; one below 0 is the distance of the gel from the object
) -> tuple[Array, float]:  # (rows, cols) as of `press_relief`; how far the sensor moves along its z, m
    """Move a sensor towards a relief until the deepest point is at a depth."""
    if relief.shape != sensor.shape:
        raise ValueError(f"relief has shape {relief.shape}; sensor {sensor.name!r} has {sensor.shape} (rows, cols)")
    if not (relief < np.inf).all():
        raise ValueError("relief holds NaN or +inf; heights are finite, and -inf where there is no surface")
    above = gel_surface(sensor) + relief  # height over one plane: how deep, but for a constant
    deepest = np.unravel_index(int(above.argmax()), above.shape)
    if above[deepest] == -np.inf:
        raise InvalidInput("the relief has no surface: all its heights are -inf")
    thickness = float(np.broadcast_to(gel_surface(sensor), sensor.shape)[deepest])
    if not least < depth < thickness:
        raise InvalidInput(f"depth is {depth} m; a press into sensor {sensor.name!r} is more than 0 and less than the gel, {thickness} m")
    distance = gel_surface(sensor) - (above - above[deepest] + depth)
    return np.where(distance > sensor.range, np.inf, np.maximum(distance, 0.0)), float(depth - above[deepest])


def random_press(
    sensor: Sensor,
    rng: np.random.Generator,
    ranges: PressRanges | None = None,  # by default those of `PressRanges`
    shapes: Sequence[str] | None = None,  # names from `SHAPES` to choose from; by default all
) -> Press:
    """Draw a press: a shape of random size, position, turn, tilt and depth. Shapes may be cut by the gel's rim.

    Equal states of `rng` give equal presses, also with other pixel counts, except for a shape at the rim that lies between the pixels, or
    deeper than the gel is thick there: another is drawn instead, up to `ATTEMPTS` times.

    >>> sensor = load_sensor("gelsight", shape=(240, 320))
    >>> press = random_press(sensor, np.random.default_rng(0))
    >>> image = tactile_image(press.depth, sensor)
    """
    names, limits = tuple(map(known_shape, shapes or SHAPES)), ranges or PressRanges()
    return first_that_fits(press_drawn, partial(draw_shape, shapes=names), sensor, rng, limits)


def first_that_fits(draw: Callable[..., T], *arguments: object) -> T:
    """Draw something that is pressed until the sensor can be pressed so, up to `ATTEMPTS` times."""
    for _ in range(ATTEMPTS):
        try:
            return draw(*arguments)
        except InvalidInput as error:  # at the rim or on a thin part: between the pixels, or where the gel is thin
            refused = error
    raise InvalidInput(
        f"none of {ATTEMPTS} shapes or patches that were drawn can be pressed: {refused}; draw larger ones, press less deep, and see that "
        "the object's unit is right"
    )


def press_drawn(draw: Callable[..., Relief], sensor: Sensor, rng: np.random.Generator, ranges: PressRanges) -> Press:
    """Press what `draw_shape` or `draw_patch` draws, to its depth."""
    relief = draw(sensor, rng, ranges)
    return Press(relief.shape, press_relief(relief.heights[0], sensor, relief.depth))


def draw_shape(
    sensor: Sensor,
    rng: np.random.Generator,
    ranges: PressRanges,
    path: Array = AT_REST,  # (steps, 4, 4) sensor frame to that before the path, turned about its axis and shifted in its plane, m
    *,
    shapes: Sequence[str],  # names from `SHAPES`
) -> Relief:
    """Draw a shape, as `random_press` says."""
    name = shapes[int(rng.integers(len(shapes)))]
    depth, size = rng.uniform(*ranges.depth), draw_mostly_small(ranges.size, rng)
    middle = rng.uniform(-ranges.middle, ranges.middle, 2) * (sensor.width, sensor.height)
    turn, towards = draw_direction(rng), draw_direction(rng)
    slope = rng.uniform(0, math.tan(ranges.tilt)) if rng.random() < TILTED else 0.0
    x, y = np.meshgrid(*pixel_centres(sensor))
    motion = path[..., None, None]
    across, along = (motion[:, k, 0] * x + motion[:, k, 1] * y + motion[:, k, 3] - middle[k] for k in (0, 1))
    u, v = turn[1] * across + turn[0] * along, turn[1] * along - turn[0] * across
    heights = SHAPES[name](u, v, ShapeDraw(size, depth, rng)) + slope * (towards[1] * u + towards[0] * v)
    return Relief(name, heights, path, 1.0, depth)


def known_shape(name: str) -> str:
    """Return the name of a random press; raise an `InvalidInput` if there is no such shape."""
    if name not in SHAPES:
        raise InvalidInput(f"there is no shape {name!r}; there are {', '.join(SHAPES)}")
    return name


def draw_mostly_small(limits: tuple[float, float], rng: np.random.Generator) -> float:
    """Draw a number between two: half of them lie in the lowest quarter."""
    return limits[0] + (limits[1] - limits[0]) * float(rng.random()) ** 2


def draw_direction(rng: np.random.Generator) -> tuple[float, float]:
    """Draw a direction; returns its sine and cosine."""
    sine, cosine = sin_cos(np.array(rng.uniform(0, 2 * math.pi)))
    return float(sine), float(cosine)


class ShapeDraw(NamedTuple):
    """The drawn properties of a shape, and the generator of the others."""

    size: float  # radius, m
    depth: float  # in the gel, m
    rng: np.random.Generator


def _ellipsoid(x: Array, y: Array, draw: ShapeDraw) -> Array:
    flatter, longer = draw.rng.uniform(0.4, 1.0, 2)
    return np.asarray(flatter * _dome(draw.size, x**2 + (y / longer) ** 2))


def _cone(x: Array, y: Array, draw: ShapeDraw) -> Array:
    """Make a cone, blunt at the tip: of radius `size` at most."""
    radius, slope = np.hypot(x, y), draw.rng.uniform(0.2, 1.2)
    blunt = draw.rng.uniform(0.02, 0.4) * draw.size
    return np.where(radius < draw.size, slope * (blunt - np.hypot(radius, blunt)), -np.inf)


def _pyramid(x: Array, y: Array, draw: ShapeDraw) -> Array:
    flat = draw.rng.uniform(0.1, 0.6) * draw.size
    return -draw.rng.uniform(0.15, 1.0) * np.maximum(_outside(x, y, draw) + draw.size - flat, 0)


def _edge(x: Array, y: Array, draw: ShapeDraw) -> Array:
    """Make a ridge with two flanks, and rounded."""
    left, right = draw.rng.uniform(0.15, 1.5, 2)
    blunt, half = draw.rng.uniform(0.01, 0.2) * draw.size, draw.rng.uniform(0.5, 4.0) * draw.size
    return np.where(np.abs(x) < half, -np.where(y < 0, left, right) * (np.hypot(y, blunt) - blunt), -np.inf)


def _bumps(x: Array, y: Array, draw: ShapeDraw) -> Array:
    """Make several round bumps beside each other."""
    count = int(draw.rng.integers(2, 9))
    tops = [
        (draw.rng.uniform(-1, 1, 2) * draw.size, draw.rng.uniform(0.1, 0.45) * draw.size, draw.rng.uniform(0, 0.7) * draw.depth)
        for _ in range(count)
    ]
    domes = [_dome(radius, (x - at[0]) ** 2 + (y - at[1]) ** 2) - radius - lower for at, radius, lower in tops]
    return np.asarray(np.max(domes, axis=0))


def _stairs(x: Array, y: Array, draw: ShapeDraw) -> Array:
    """Make a flight of stairs, with upright walls around it."""
    tread, rise = draw.rng.uniform(0.2, 0.8) * draw.size, draw.rng.uniform(0.2, 0.7) * draw.depth
    along = np.abs(x) / tread if draw.rng.random() < 0.3 else (x + draw.size) / tread  # a pyramid of steps, or one way
    wall = draw.rng.uniform(*WALLS)
    steps, share = np.floor(along), along - np.floor(along)
    smooth = np.minimum(share * tread * wall / rise, 1.0)  # each step falls along a wall, from the tread before
    heights = -rise * np.maximum(steps - 1 + smooth, 0.0)
    return np.asarray(heights - wall * np.maximum(np.maximum(np.abs(x), np.abs(y)) - draw.size, 0))


def _relief(x: Array, y: Array, draw: ShapeDraw) -> Array:
    """Make a rough plate: waves of several lengths and directions, as deep as the press; round, with upright walls."""
    heights = np.zeros_like(x)
    for _ in range(12):
        length, phase, (sine, cosine) = draw.rng.uniform(0.25, 1.2) * draw.size, draw.rng.random(), draw_direction(draw.rng)
        turns = (cosine * x + sine * y) / length + phase
        share = 2 * (turns - np.floor(turns)) - 1
        heights += 4 * share * (1 - np.abs(share))  # nearly a sine, in fewer steps and with the same bits everywhere
    amplitude = draw.rng.uniform(0.05, 0.5) * draw.depth / math.sqrt(6)  # of a standard deviation of 1
    return amplitude * heights - draw.rng.uniform(*WALLS) * np.maximum(np.hypot(x, y) - draw.size, 0)


def _dome(radius: float, squared: Array) -> Array:
    """Compute heights of a ball's or cylinder's upper half over its middle plane, by squared distance from the axis."""
    inside = radius**2 - squared
    return np.where(inside > 0, np.sqrt(np.maximum(inside, 0)), -np.inf)


def _outside(x: Array, y: Array, draw: ShapeDraw) -> Array:
    """Compute the distance of points beyond the sides of a polygon of 3 to 6 corners, m; negative inside, at least `-size`."""
    count = int(draw.rng.integers(3, 7))
    sines, cosines = sin_cos(2 * math.pi / count * (np.arange(count) + draw.rng.uniform(-0.25, 0.25, count)))
    reach = draw.size * draw.rng.uniform(0.6, 1.0, count)
    sides = [cosine * x + sine * y - offset for sine, cosine, offset in zip(sines, cosines, reach, strict=True)]
    return np.asarray(np.max(sides, axis=0))


SHAPES: Mapping[str, Callable[[Array, Array, ShapeDraw], Array]] = {
    "ball": lambda x, y, draw: _dome(draw.size, x**2 + y**2),
    "ellipsoid": _ellipsoid,
    "cone": _cone,
    "cylinder": lambda x, y, draw: np.where(np.abs(x) < draw.rng.uniform(0.5, 4.0) * draw.size, _dome(draw.size, y**2), -np.inf),
    "prism": lambda x, y, draw: -draw.rng.uniform(*WALLS) * np.maximum(_outside(x, y, draw), 0),
    "pyramid": _pyramid,
    "post": lambda x, y, draw: -draw.rng.uniform(*WALLS) * np.maximum(np.hypot(x, y) - 0.7 * draw.size, 0),
    "edge": _edge,
    "ring": lambda x, y, draw: _dome(draw.rng.uniform(0.1, 0.45) * draw.size, (np.hypot(x, y) - draw.size) ** 2),
    "bumps": _bumps,
    "stairs": _stairs,
    "relief": _relief,
}
"""The shapes of random presses by name: each makes a relief (rows, cols), m, from the positions of pixels in its own frame, m."""


def draw_patch(
    faces: BoxedFaces,
    points: Floats,  # (N, 3) of the object's surface, frame of the faces, m
    normals: Floats,  # (N, 3) outward unit normals there
    sensor: Sensor,
    rng: np.random.Generator,
    ranges: PressRanges,  # of depth, tilt and scale
    path: Array = AT_REST,  # as in `draw_shape`
) -> Relief:
    """Draw a patch of an object, of shape "patch", made smaller so that more of it fits on the gel."""
    low, high = (faces.centre - faces.half).min(axis=1), (faces.centre + faces.half).max(axis=1)
    distance = float(length(high - low))  # from a point of the object, as far as no part of it is
    size = draw_mostly_small(ranges.scale, rng)
    sides = {"width": sensor.width / size, "given_height": sensor.height / size, "range": 2 * distance}
    enlarged, facing = sensor.model_copy(update=sides), _facing(points, normals, distance, ranges.tilt, rng)
    scaled = np.ones((4, 4))  # what the entries of a pose are multiplied by for the scaled object
    scaled[:3, 3] = size
    poses = compose(facing, path / scaled)
    heights = np.stack([-size * ray_depth(faces, pose, enlarged) for pose in poses])
    return Relief("patch", heights, poses * scaled, size, rng.uniform(*ranges.depth))


def _facing(points: Floats, normals: Floats, distance: float, tilt: float, rng: np.random.Generator) -> Array:
    """Draw the pose (4, 4) of a sensor that faces a point of a surface from a distance, tilted by up to an angle, turned at random."""
    index = int(rng.integers(len(points)))
    away = -np.asarray(normals[index], np.float64)
    aside = np.cross(away, rng.normal(size=3))
    aside = unit_vectors(aside)  # any direction across the normal: it turns the sensor, and the tilt is about it
    z = unit_vectors(away + rng.uniform(0, math.tan(tilt)) * np.cross(aside, away))
    return pose_of(np.stack([aside, np.cross(z, aside), z], axis=1), np.asarray(points[index], np.float64) - distance * z)
