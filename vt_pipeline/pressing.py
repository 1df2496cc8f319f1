"""Presses without a hand: images of depth maps, and reliefs or objects pressed to a depth."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.touch import tactile_image as kernel
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.press_shapes import press_relief
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import tactile_image
from vt_pipeline.objects import Source, TouchObject, as_object
from vt_pipeline.touching import Touch, as_poses, as_rng, as_sensor, touch

DEPTH_TOLERANCE = 1e-6  # m, within which an object is pressed to the depth asked for; rays meet the same points from all along the normal


def image(depth: np.ndarray, sensor: Sensor | str | Path, rng: np.random.Generator | None = None) -> NDArray[np.uint8]:
    """Compute the tactile image of a depth map.

    Parameters
    ----------
    depth
        (rows, cols) distance D of an object from the sensor plane, m; +inf where there is none. The gel begins at `sensor.w`.
    sensor
        From `load_sensor`, or what that takes; `load_sensor(name, shape=depth.shape)` gives it the pixels of the depth map.
    rng
        Draws the pixel noise of a sensor that has some; None for an image without noise.

    Returns
    -------
    (rows, cols, 3) uint8.

    Raises
    ------
    InvalidInput
        The depth map has not the sensor's shape, or holds NaN or negative values.
    """
    sensor, depth, rng = as_sensor(sensor), _as_map("depth", depth), as_rng(rng)
    try:
        return tactile_image(depth, sensor, rng)
    except ValueError as error:
        raise InvalidInput(str(error)) from error


def untouched_image(sensor: Sensor | str | Path) -> NDArray[np.uint8]:
    """Compute the tactile image (rows, cols, 3) of a sensor, from `load_sensor` or what that takes, with nothing in its gel."""
    return kernel.untouched_image(as_sensor(sensor))


def press(
    object_: TouchObject | Source | np.ndarray,
    sensor: Sensor | str | Path,
    pose: np.ndarray | None = None,
    *,
    depth: float | None = None,
    rng: np.random.Generator | None = None,
) -> Touch:
    """Press a relief or an object into a sensor's gel, without a hand.

    Parameters
    ----------
    object_
        (rows, cols) heights towards the gel, m, one per pixel, -inf where there is none; or an object as `touch` takes it.
    sensor
        From `load_sensor`, or what that takes.
    pose
        Of an object: (4, 4) sensor frame to object frame, m. A relief has none: it lies on the sensor's pixels.
    depth
        How deep the deepest point lies in the gel, m. A relief needs it; with an object, the sensor is moved along its normal until it
        is so, from where `pose` says, which is outside the object; by default it stays there.
    rng
        Draws the pixel noise of a sensor that has some; None for an image without noise.

    Returns
    -------
    The touch; that of a relief in the sensor's own frame.

    Raises
    ------
    InvalidInput
        A relief has another shape than the sensor, or no surface; a pose is not a rigid motion, or no surface is in front of it, or
        a part of the object would be in the gel beyond it; the depth is not between 0 and the gel's thickness.

    Examples
    --------
    >>> sensor = load_sensor("gelsight_mini", shape=(240, 320))
    >>> x, y = np.meshgrid(np.linspace(-9e-3, 9e-3, 320), np.linspace(-7e-3, 7e-3, 240))
    >>> touch = press(-(x**2 + y**2) / (2 * 0.005), sensor, depth=0.5e-3)  # a ball of 5 mm radius
    """
    sensor, rng = as_sensor(sensor), as_rng(rng)
    try:
        depth = None if depth is None else float(depth)
    except (TypeError, ValueError) as error:
        raise TypeError(f"depth is a number, m; this is {type(depth).__name__}") from error
    if isinstance(object_, np.ndarray):
        if pose is not None or depth is None:
            raise TypeError("a relief lies on the sensor's pixels: give its depth and no pose")
        try:
            met = press_relief(_as_map("a relief", object_), sensor, depth).astype(np.float32)
        except ValueError as error:
            raise InvalidInput(str(error)) from error
        return Touch(sensor, np.eye(4), met, tactile_image(met, sensor, rng))
    if pose is None:
        raise TypeError("an object needs a pose, (4, 4) sensor frame to object frame; a relief is a numpy array")
    object_, pose = as_object(object_), as_poses("pose", pose)
    if depth is None:
        return touch(object_, sensor, pose, rng=rng)
    depth_map = ray_depth(object_.faces, pose, sensor)
    if np.isinf(depth_map).all():
        raise InvalidInput(f"no surface lies within {sensor.range} m in front of the pose; move it towards the object:\n{pose}")
    press_relief(-depth_map, sensor, depth)  # checks the depth
    pose = pose.copy()
    pose[:3, 3] += (depth - _deepest(depth_map, sensor)) * pose[:3, 2]
    touched = touch(object_, sensor, pose, rng=rng)
    if abs((reached := _deepest(touched.depth, sensor)) - depth) > DEPTH_TOLERANCE:
        raise InvalidInput(f"part of the object begins behind the pose's plane and would lie {reached:.3g} m deep; begin outside")
    return touched


def _deepest(depth_map: NDArray[np.floating], sensor: Sensor) -> float:
    """Compute how deep the deepest point of a depth map lies in the gel, m."""
    return float((gel_surface(sensor) - depth_map).max())


def _as_map(name: str, array: np.ndarray) -> np.ndarray:
    """Return a map of numbers as floats; a `TypeError` for anything else."""
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "fiu":
        description = f"an array {array.shape} of {array.dtype}" if isinstance(array, np.ndarray) else type(array).__name__
        raise TypeError(f"{name} is an array (rows, cols) of numbers; this is {description}")
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)
