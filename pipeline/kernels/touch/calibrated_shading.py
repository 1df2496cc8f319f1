"""The colours of a calibrated sensor, compiled: a polynomial of the gel's normal and depth, whose coefficients depend on the position.

Lamps cast shadows behind bumps of the gel: they are found by a sweep along each lamp's direction.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.sensor import MM, POSITION_TERMS, SLOPE_TERMS, Box, Calibration, Sensor, pixel_centres

FLAT = 1e-7  # m of indentation below which pixels at the ends of a row, also above and below, are not shaded


def shade_depth(
    bump: Array,  # (rows, cols) height towards the camera, m; negative where an elastic gel rises; 0 beyond the image
    pitch: tuple[float, float],  # size of a pixel along y and x, m
    *,
    direction: float,  # towards the lamp, rad from +x to +y
    slope: float,  # height over length of the lamp's rays, > 0
) -> Array:  # (rows, cols) m, >= 0: below the edge of the shade, along the height
    """Compute how deep each point lies in the shade of a distant lamp, whose edge is carried from line to line, interpolated."""
    step_y, step_x = math.sin(direction) / pitch[0], math.cos(direction) / pitch[1]  # pixels per m towards the lamp
    swapped = abs(step_x) > abs(step_y)
    image = np.ascontiguousarray(bump.T if swapped else bump)
    major, minor = (step_x, step_y) if swapped else (step_y, step_x)
    if major > 0:
        image = image[::-1].copy()
    shade = np.empty_like(image)
    _sweep(image, minor / abs(major), slope / abs(major), shade)
    if major > 0:
        shade = shade[::-1]
    return shade.T if swapped else shade


@compiled
def _sweep(image: Array, shift: float, drop: float, shade: Array) -> None:
    """Sweep from line 0, nearest to the lamp; the line before lies `shift` pixels aside, rays fall `drop` per line."""
    lines, length = image.shape
    offset = math.floor(shift)
    share = shift - offset
    edge, padded = np.full(length, -drop), np.zeros(length + 4)
    for line in range(lines):
        row, out = image[line], shade[line]
        for i in range(length):
            out[i] = max(edge[i] - row[i], 0.0)
            padded[i + 2] = max(edge[i], row[i])
        near, far = padded[offset + 2 : offset + 2 + length], padded[offset + 3 : offset + 3 + length]
        for i in range(length):
            edge[i] = near[i] + share * (far[i] - near[i]) - drop


def indentation_change(bump: Array, sensor: Sensor, calibration: Calibration) -> Array:  # (rows, cols, 3) levels
    """Compute the change of colours of a gel that lies below its rest by `bump` (rows, cols), m; 0 where it stays flat and lit."""
    change = np.zeros((*sensor.shape, 3))
    casting = np.minimum(bump, calibration.deepest)
    if bump.any():
        x, y = fitted_positions(sensor, calibration.within)
        shading = np.array(calibration.coefficients)
        degrees = SLOPE_TERMS[shading.shape[1]], POSITION_TERMS[shading.shape[2]]
        if calibration.depth is not None:
            shading = np.concatenate([shading, MM * np.array(calibration.depth)[:, None]], axis=1)
        _shade(bump, casting, sensor.pitch, x, y, shading, degrees, calibration.steepest, change)
    for shadow in calibration.shadows if bump.any() else ():
        depth = shade_depth(casting, sensor.pitch, direction=np.deg2rad(shadow.direction), slope=shadow.slope)
        change += depth[:, :, None] * (MM * np.array(shadow.gain))
    return change


def fitted_positions(sensor: Sensor, within: Box | None) -> tuple[Array, Array]:  # x (cols,) and y (rows,), sensor widths
    """Compute where the coefficients of pixels are evaluated: at the nearest position in the fitted part of the gel."""
    x, y = pixel_centres(sensor)
    if within is not None:
        x, y = np.clip(x, within[0], within[2]), np.clip(y, within[1], within[3])
    return x / sensor.width, y / sensor.width


def slope_degrees(calibration: Calibration) -> float:
    """Compute the steepest fitted slope, degrees."""
    return math.degrees(math.asin(calibration.steepest))


def fitted_range(calibration: Calibration) -> list[str]:
    """Describe the slopes, depths and positions in which colours were fitted, as lines of text."""
    slopes = f"fitted: slopes up to {slope_degrees(calibration):.0f} degrees"
    if calibration.within is None:
        return [f"{slopes}; the file does not say where contacts were (`within`): colours elsewhere are extrapolated, calibrate again"]
    left, top, right, bottom = (MM * side for side in calibration.within)
    depth = f"contacts up to {MM * calibration.deepest:.2f} mm deep"
    return [
        f"{slopes}, {depth}, x {left:.1f} to {right:.1f} mm, y {top:.1f} to {bottom:.1f} mm",
        "beyond, colours are those of the nearest slope, depth and position in this range",
    ]


@lru_cache(maxsize=8)
def polynomial_background(sensor: Sensor, coefficients: tuple[tuple[float, float, float], ...]) -> Array:
    """Compute an untouched image (rows, cols, 3), levels, from its coefficients by term of the position; it is read-only."""
    x, y = (centres / sensor.width for centres in pixel_centres(sensor))
    image = np.zeros((*sensor.shape, 3))
    terms = polynomial_terms(x[None], y[:, None], POSITION_TERMS[len(coefficients)])
    for term, levels in zip(terms, coefficients, strict=True):
        image += term[:, :, None] * np.array(levels)
    image.flags.writeable = False
    return image


def powers(degree: int) -> list[tuple[int, int]]:
    """List the powers of two variables in the terms of a polynomial: 1, a, b, a², a b, b², …."""
    return [(i, total - i) for total in range(degree + 1) for i in range(total, -1, -1)]


def polynomial_terms(x: Any, y: Any, degree: int) -> list[Any]:
    """Compute the terms of a polynomial of two arrays or tensors, in the order of `powers`."""
    return [x**i * y**j for i, j in powers(degree)]


@compiled
def _shade(
    bump: Array,  # (rows, cols) m
    casting: Array,  # (rows, cols) m, at most the deepest that was fitted
    pitch: tuple[float, float],  # along y and x, m
    x: Array,  # (cols,) sensor widths
    y: Array,  # (rows,) sensor widths
    shading: Array,  # (3, terms of the normal and, if there is one, the depth, terms of the position)
    degrees: tuple[int, int],  # in the normal and in the position
    steepest: float,
    change: Array,  # (rows, cols, 3) changed in place
) -> None:
    """Add the change of colours at every pixel that is drawn in or next to one that is, row by row."""
    rows, cols = bump.shape
    slopes, position_degree = degrees
    terms = np.empty((shading.shape[1], cols))
    light, local = np.empty(cols), np.empty(cols)
    for row in range(rows):
        above, below = max(row - 1, 0), min(row + 1, rows - 1)
        first, last = 0, cols - 1
        while first < cols and abs(bump[row, first]) < FLAT and abs(bump[above, first]) < FLAT and abs(bump[below, first]) < FLAT:
            first += 1
        while last > first and abs(bump[row, last]) < FLAT and abs(bump[above, last]) < FLAT and abs(bump[below, last]) < FLAT:
            last -= 1
        if first == cols:
            continue
        first, last = max(first - 1, 0), min(last + 1, cols - 1)
        for col in range(first, last + 1):
            left, right = max(col - 1, 0), min(col + 1, cols - 1)
            slope_x = (bump[row, right] - bump[row, left]) / ((right - left) * pitch[1])
            slope_y = (bump[below, col] - bump[above, col]) / ((below - above) * pitch[0])
            squared = slope_x * slope_x + slope_y * slope_y
            size = np.sqrt(1.0 + squared)
            if squared > steepest * steepest * size * size:  # as tilted as the steepest that was fitted
                size = np.sqrt(squared) / steepest
            terms[0, col], terms[1, col] = slope_x / size, slope_y / size
        number = 2
        for degree in range(2, slopes + 1):  # each term is one of the degree before times nx, the last times ny
            previous = number - degree
            for k in range(degree + 1):
                factor, source = (terms[0], terms[previous + k]) if k < degree else (terms[1], terms[number - 1])
                into = terms[number + k]
                for col in range(first, last + 1):
                    into[col] = factor[col] * source[col]
            number += degree + 1
        if number < shading.shape[1]:  # the depth's own colours come last
            for col in range(first, last + 1):
                terms[number, col] = casting[row, col]
        across = x[first : last + 1]
        for channel in range(3):
            total = light[first : last + 1]
            total[:] = 0.0
            for term in range(shading.shape[1]):
                value = local[first : last + 1]
                value[:] = 0.0
                for i in range(position_degree, -1, -1):  # Horner's rule in x; the coefficients are polynomials in y
                    factor_y = 0.0
                    for j in range(position_degree - i, -1, -1):
                        factor_y = factor_y * y[row] + shading[channel, term, (i + j) * (i + j + 1) // 2 + j]
                    for n in range(len(value)):
                        value[n] = value[n] * across[n] + factor_y
                term_values = terms[term, first : last + 1]
                for n in range(len(value)):
                    total[n] += term_values[n] * value[n]
            for n in range(len(total)):
                change[row, first + n, channel] += total[n]
