"""Patches of an object as reliefs: what a gel meets when it is pressed onto the object from outside."""

import math

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.geometry.transforms import length, unit_vectors
from pipeline.kernels.touch.face_culling import BoxedFaces
from pipeline.kernels.touch.press_shapes import ATTEMPTS, Press, PressRanges, draw_mostly_small, press_relief
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor


def random_patch(
    faces: BoxedFaces,
    points: Floats,  # (N, 3) of the object's surface, frame of the faces, m
    normals: Floats,  # (N, 3) outward unit normals there
    sensor: Sensor,
    rng: np.random.Generator,
    *,
    ranges: PressRanges | None = None,  # of depth and tilt; by default those of `PressRanges`
    scale: tuple[float, float] = (0.04, 0.5),  # least and greatest size of the pressed object, of its own size
) -> Press:
    """Draw a press, of shape "patch", of a patch of an object, made smaller so that more of it fits on the gel.

    `InvalidInput` if, at `ATTEMPTS` points, no ray meets the object, or it is deeper than the gel.
    """
    ranges = ranges or PressRanges()
    low, high = (faces.centre - faces.half).min(axis=1), (faces.centre + faces.half).max(axis=1)
    distance = float(length(high - low))  # from a point of the object, as far as no part of it is
    for _ in range(ATTEMPTS):
        size = draw_mostly_small(scale, rng)
        sides = {"width": sensor.width / size, "given_height": sensor.height / size, "range": 2 * distance}
        pose = _facing(points, normals, distance, ranges.tilt, rng)
        distances = ray_depth(faces, pose, sensor.model_copy(update=sides))
        depth = rng.uniform(*ranges.depth)
        try:
            return Press("patch", press_relief(-size * distances, sensor, depth))
        except InvalidInput as error:  # rays pass thin parts between two pixels, or the gel is thin there
            refused = error
    raise InvalidInput(f"none of {ATTEMPTS} patches that were drawn can be pressed: {refused}")


def _facing(points: Floats, normals: Floats, distance: float, tilt: float, rng: np.random.Generator) -> Array:
    """Draw the pose (4, 4) of a sensor that faces a point of a surface from a distance, tilted by up to an angle, turned at random."""
    index = int(rng.integers(len(points)))
    away = -np.asarray(normals[index], np.float64)
    aside = np.cross(away, rng.normal(size=3))
    aside = unit_vectors(aside)  # any direction across the normal: it turns the sensor, and the tilt is about it
    z = unit_vectors(away + rng.uniform(0, math.tan(tilt)) * np.cross(aside, away))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([aside, np.cross(z, aside), z], axis=1)
    pose[:3, 3] = np.asarray(points[index], np.float64) - distance * z
    return pose
