"""Depth maps above a gel: its undeformed surface, touches and their points, quantisation; and the gel that an object is pressed into.

A gel is elastic, or has a membrane that the contact pulls in, less with distance.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Array32, Mask, check_shape
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.elastic_contact import PressedGel, press_elastic
from pipeline.kernels.touch.sensor import Sensor, check_pose, masked_points, pixel_centres, sensor_to_world

CONTACT_MARGIN = 1e-4  # m by which a surface must press into the gel to touch; less is within the accuracy of physics
COLUMNS_AT_ONCE = 64  # smoothed together: they fit the cache of a processor
PASSES = 2  # passes of the exponential filter along each axis: with two its response is nearly round


@lru_cache(maxsize=16)
def gel_surface(sensor: Sensor) -> Array:  # (rows, cols) m, read-only; () where the gel is flat, w
    """Compute the height of the undeformed gel above the sensor plane."""
    if sensor.surface is None:
        return np.array(sensor.w)
    x, y = pixel_centres(sensor)
    if sensor.surface.radius is not None:
        across = {"both": x[None] ** 2 + y[:, None] ** 2, "x": x[None] ** 2 + 0 * y[:, None], "y": 0 * x[None] + y[:, None] ** 2}
        radius = sensor.surface.radius
        surface = sensor.w - (radius - np.sqrt(radius**2 - across[sensor.surface.along]))
    else:
        heights = np.array(sensor.surface.heights)
        grid = [np.linspace(-side / 2, side / 2, count) for side, count in zip((sensor.height, sensor.width), heights.shape, strict=True)]
        surface = scipy.interpolate.RegularGridInterpolator(grid, heights)(np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1))
    surface.flags.writeable = False
    return np.asarray(surface)


@lru_cache(maxsize=16)
def gel_top(sensor: Sensor) -> float:
    """Compute the greatest height of the undeformed gel above the sensor plane, m: w, or more for a height map."""
    return max(sensor.w, float(gel_surface(sensor).max()))


def in_gel(depth: np.ndarray, sensor: Sensor) -> Mask:  # (..., rows, cols), as depth, m
    """Find the pixels where a surface lies in the gel, D < w: its shape. `pressed_pixels` decides what touches."""
    return np.asarray(depth < gel_surface(sensor))


def impression(depth: np.ndarray, sensor: Sensor) -> Array:
    """Compute the impression (rows, cols), m, of a depth map D: ReLU(w - D), equation 1; w is the gel's height at the pixel."""
    check_shape("depth", depth, *sensor.shape)
    if not (depth >= 0).all():
        raise ValueError("depth holds NaN or negative values; it must be 0 or more, and +inf where nothing is met")
    pressed: Array = np.subtract(gel_surface(sensor), depth, dtype=np.float64)
    np.maximum(pressed, 0.0, out=pressed)
    return pressed


def touch_success(depth: np.ndarray, sensor: Sensor) -> Mask:  # (...)
    """Decide whether sensors touch, from (..., rows, cols) depth, m: 0 < min D, and D < w - `CONTACT_MARGIN` somewhere.

    Depth is judged in float32, as it is stored: the stored depth gives the same mask, unless quantisation moved it across the limit.
    """
    _check_numbers(depth)
    return np.asarray(pressed_pixels(depth, sensor).any(axis=(-2, -1)) & (depth.astype(np.float32).min(axis=(-2, -1)) > 0))


def _check_numbers(depth: np.ndarray) -> None:
    if np.isnan(depth).any():
        raise ValueError("depth holds NaN; where nothing is met it must be +inf")


def pressed_pixels(depth: np.ndarray, sensor: Sensor) -> Mask:  # (..., rows, cols), as depth
    """Find the pixels that touch: 0 < D < w - `CONTACT_MARGIN`, the rule of `touch_success`."""
    judged = depth.astype(np.float32).astype(np.float64)
    return np.asarray((judged > 0) & (judged < gel_surface(sensor) - CONTACT_MARGIN))


def beyond_ranges(
    indentation: np.ndarray,  # (..., S) m, of the deepest point in each gel
    sensors: Sequence[Sensor],  # S
) -> tuple[Mask, Mask]:  # (..., S) each
    """Find touches that are deeper than the gel's layer, and than the deepest contact that the sensor's colours were fitted to."""
    layers = np.array([sensor.layer_thickness for sensor in sensors])
    fitted = np.array([sensor.calibrated.deepest if sensor.calibrated else np.inf for sensor in sensors])
    return indentation > layers, indentation > fitted


def local_points(
    depth: np.ndarray,  # (rows, cols) float32 D as stored, m
    pose: np.ndarray,  # (4, 4) float64, sensor frame to world frame
    sensor: Sensor,
) -> tuple[Array32, np.int32]:  # (rows · cols, 3) world, m, in row-major order of the pixels, zeros beyond their number
    """Compute the points S^loc of a depth map that lie in the gel, D < w (supplement 1.5).

    Within 10 m of the origin the error of a coordinate is below 0.5 µm. The result is a function of the stored arrays, to the bit.
    """
    if depth.dtype != np.float32 or depth.shape != sensor.shape:
        raise ValueError(f"depth is {depth.dtype} {depth.shape}; local points need the stored one, float32 {sensor.shape}")
    _check_numbers(depth)
    local = masked_points(depth, in_gel(depth.astype(np.float64), sensor), sensor)
    points = np.zeros((depth.size, 3), np.float32)
    points[: len(local)] = sensor_to_world(check_pose(pose), *local.T)
    return points, np.int32(len(local))


def quantise_depth(
    depth: Array,  # (..., rows, cols) m, +inf where nothing is met
    sensor: Sensor,
    *,
    gel_bits: int | None,  # depths in the gel become multiples of 2^-gel_bits m; None keeps float32's precision
    far_bits: int | None,  # depths beyond it become multiples of 2^-far_bits m
) -> Array32:  # (..., rows, cols) m
    """Round depths to multiples of a power of two; digits beyond any use are noise that no codec can compress.

    The error is at most half a step and half a float32 unit in the last place. Depths beyond the gel's highest point stay beyond it.
    """
    _check_numbers(depth)
    rounded = np.empty(depth.shape, np.float32)
    gel_steps, far_steps = (0.0 if bits is None else 2.0**bits for bits in (gel_bits, far_bits))
    gel = gel_top(sensor)
    beyond = np.float32(gel)
    beyond = beyond if beyond >= gel else np.nextafter(beyond, np.float32(np.inf))
    _round(np.ascontiguousarray(depth).reshape(-1), gel, beyond, gel_steps, far_steps, rounded.reshape(-1))
    return rounded


@compiled
def _round(depth: Array, gel: float, beyond: np.float32, gel_steps: float, far_steps: float, rounded: Array32) -> None:
    """Round to multiples of 1/gel_steps below `gel` and of 1/far_steps beyond, or to `beyond`, the least float32 not below it."""
    for i in range(len(depth)):
        steps = gel_steps if depth[i] < gel else far_steps
        rounded[i] = depth[i] if steps == 0 else np.rint(depth[i] * steps) / steps
        if depth[i] >= gel > rounded[i]:
            rounded[i] = beyond


def membrane_indentation(pressed: Array, sigma: tuple[float, float]) -> Array:  # (rows, cols) m
    """Compute the indentation of the membrane in and around a contact: the larger of D' and of D' smoothed.

    Smoothing, of a standard deviation along y and x, pixels, is a recursive two-sided exponential filter, `PASSES` times along each axis;
    the gel is flat beyond the image.
    """
    decay_y, decay_x = (math.exp(-math.sqrt(2 * PASSES) / pixels) for pixels in sigma)
    smooth = pressed.T.copy()
    _smooth_columns(smooth, decay_x)
    smooth = np.ascontiguousarray(smooth.T)
    _smooth_columns(smooth, decay_y)
    return np.maximum(pressed, smooth, out=smooth)


@compiled
def _smooth_columns(image: Array, decay: float) -> None:
    """Smooth the columns in place, `PASSES` times."""
    rows, cols = image.shape
    gain = (1 - decay) / (1 + decay)
    forward, carried = np.empty((rows, COLUMNS_AT_ONCE)), np.empty(COLUMNS_AT_ONCE)
    for start in range(0, cols, COLUMNS_AT_ONCE):
        end = min(start + COLUMNS_AT_ONCE, cols)
        for _ in range(PASSES):
            carried[:] = 0.0
            for row in range(rows):
                line, into = image[row, start:end], forward[row]
                for col in range(len(line)):
                    carried[col] = line[col] + decay * carried[col]
                    into[col] = carried[col]
            carried[:] = 0.0
            for back in range(rows):
                line, into = image[rows - 1 - back, start:end], forward[rows - 1 - back]
                for col in range(len(line)):
                    ahead = decay * carried[col]
                    carried[col] = line[col] + ahead
                    line[col] = gain * (into[col] + ahead)


def press_gel(depth: np.ndarray, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an object at a depth D (rows, cols), m; without layer or membrane it gives way only there."""
    return gel_under(impression(depth, sensor), sensor)


def gel_under(pressed: Array, sensor: Sensor) -> PressedGel:
    """Compute the state of a gel under an impression (rows, cols), m; otherwise as `press_gel`."""
    if sensor.gel is not None:
        return press_elastic(pressed, sensor, sensor.gel)
    indentation = pressed
    if sensor.membrane > 0 and pressed.any():
        indentation = membrane_indentation(pressed, (sensor.membrane / sensor.pitch[0], sensor.membrane / sensor.pitch[1]))
    return PressedGel(indentation, (pressed > 0) & (indentation <= pressed))


def normal_force(pressure: Array, sensor: Sensor) -> float:
    """Add up the pressure (rows, cols), Pa, on a sensor's gel: the normal force, N."""
    return float(pressure.sum()) * sensor.pitch[0] * sensor.pitch[1]


def scaled_gel(sensor: Sensor, factor: float) -> Sensor:
    """Multiply the width of a sensor's membrane, or the thickness of its elastic gel, by a factor."""
    if sensor.gel is None:
        return sensor.model_copy(update={"membrane": sensor.membrane * factor})
    return sensor.model_copy(update={"gel": sensor.gel.model_copy(update={"thickness": sensor.layer_thickness * factor})})
