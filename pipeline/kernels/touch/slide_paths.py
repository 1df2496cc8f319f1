"""Random paths over shapes and patches of objects: press, slide, twist, lift off."""

from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import compose, pose_of, sin_cos
from pipeline.kernels.touch.press_shapes import Relief, draw_direction, lower_sensor
from pipeline.kernels.touch.sensor import Sensor

CLEARANCE = 2e-5  # m over the gel in the first and the last step
SHARE = (0.3, 0.7)  # of the time between press and lift that the object slides; then it is twisted

Limits = tuple[float, float]


class PathRanges(NamedTuple):
    """Ranges from which paths are drawn: least and greatest values."""

    depth: Limits  # of the deepest point in the gel, m
    press_speed: Limits  # m/s, of the lift too
    slide_speed: Limits  # m/s
    twist_speed: Limits  # rad/s, either way


class SlidePath(NamedTuple):
    """A path: where the sensor is at each step."""

    time: Array  # (steps,) s
    depth: Array  # (steps,) of the deepest point in the gel, m; below 0 over it
    motion: Array  # (steps, 4, 4) sensor frame to that of the first step, in its plane, m


def draw_path(steps: int, rate: float, ranges: PathRanges, rng: np.random.Generator) -> SlidePath:
    """Draw a path of some steps, at `rate` per second; press and lift have to be over in less than its time."""
    time = np.arange(steps) / rate
    deep, lowering, sliding, twisting = (rng.uniform(*limits) for limits in ranges)
    pressed = (deep + CLEARANCE) / lowering
    lifted = time[-1] - pressed
    slid = pressed + rng.uniform(*SHARE) * (lifted - pressed)
    sine, cosine = draw_direction(rng)
    turn = twisting * (np.clip(time, slid, lifted) - slid) * (1 if rng.random() < 0.5 else -1)
    distance = sliding * (np.clip(time, pressed, slid) - pressed)
    motion = [
        pose_of([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], (cosine * far, sine * far, 0))
        for far, sin, cos in zip(distance, *sin_cos(turn), strict=True)
    ]
    depth = np.interp(time, [0, pressed, lifted, time[-1]], [-CLEARANCE, deep, deep, -CLEARANCE])
    return SlidePath(time, depth, np.stack(motion))


def follow_path(
    relief: Relief,  # drawn for the path
    path: SlidePath,
    sensor: Sensor,
) -> tuple[list[Array], list[Array]]:  # depth maps (rows, cols), m; poses (4, 4), sensor frame to that of shape or scaled object, m
    """Move a sensor along a path over what was drawn; its deepest point follows the path's depth, whatever lies ahead."""
    lowered = [lower_sensor(heights, sensor, depth) for heights, depth in zip(relief.heights, path.depth, strict=True)]
    poses = [compose(pose, pose_of(np.eye(3), (0, 0, moved))) for pose, (_, moved) in zip(relief.poses, lowered, strict=True)]
    return [depth for depth, _ in lowered], poses
