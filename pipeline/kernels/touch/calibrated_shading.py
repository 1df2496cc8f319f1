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

TERMS_AT_ONCE = 5  # added in one loop, which `_add_five` writes out
FLAT = 1e-7  # m of indentation below which pixels at the ends of a row, also above and below, are not shaded


def shade_depth(
    bump: Array,  # (rows, cols) height towards the camera, m; negative where an elastic gel rises; 0 beyond the image
    pitch: tuple[float, float],  # size of a pixel along y and x, m
    *,
    direction: float,  # towards the lamp, rad from +x to +y
    slope: float,  # height over length of the lamp's rays, > 0
    highest: float = math.inf,  # m: what is higher casts its shadow
) -> Array:  # (rows, cols) m, >= 0: below the edge of the shade, along the height
    """Compute how deep each point lies in the shade of a distant lamp, whose edge is carried from line to line, interpolated."""
    step_y, step_x = math.sin(direction) / pitch[0], math.cos(direction) / pitch[1]  # pixels per m towards the lamp
    swapped = abs(step_x) > abs(step_y)
    major, minor = (step_x, step_y) if swapped else (step_y, step_x)
    lines = np.ascontiguousarray(bump.T if swapped else bump)
    shade = _sweep(lines, major > 0, minor / abs(major), slope / abs(major), highest)
    return shade.T if swapped else shade


@compiled
def _sweep(image: Array, backwards: bool, shift: float, drop: float, highest: float) -> Array:
    """Sweep from the line nearest to the lamp, the last if backwards; each is `shift` pixels aside of that before, rays fall `drop`."""
    lines, length = image.shape
    offset = math.floor(shift)
    share = shift - offset
    shade, edge, padded = np.empty(image.shape), np.full(length, -drop), np.zeros(length + 4)
    for number in range(lines):
        line = lines - 1 - number if backwards else number
        row, out, reached = image[line], shade[line], padded[2 : 2 + length]
        for i in range(length):
            height = row[i] if row[i] < highest else highest
            out[i] = edge[i] - height if edge[i] > height else 0.0
            reached[i] = edge[i] if edge[i] > height else height
        near, far = padded[offset + 2 : offset + 2 + length], padded[offset + 3 : offset + 3 + length]
        for i in range(length):
            edge[i] = near[i] + share * (far[i] - near[i]) - drop
    return shade


def indentation_change(
    bump: Array,  # (rows, cols) m
    sensor: Sensor,
    calibration: Calibration,
    image: Array | None = None,  # (rows, cols, 3) levels, to which the change is added; by default 0
) -> Array:  # (rows, cols, 3) levels
    """Compute the change of colours of a gel that lies below its rest by `bump`; 0 where it stays flat and lit."""
    image = np.zeros((*sensor.shape, 3)) if image is None else image
    if not bump.any():
        return image
    x, y = fitted_positions(sensor, calibration.within)
    shading = np.array(calibration.coefficients)
    degrees = SLOPE_TERMS[shading.shape[1]], POSITION_TERMS[shading.shape[2]]
    depth = np.zeros((3, 1, shading.shape[2])) if calibration.depth is None else MM * np.array(calibration.depth)[:, None]
    spare = np.zeros((3, -(shading.shape[1] + 1) % TERMS_AT_ONCE, shading.shape[2]))
    shading = np.concatenate([shading, depth, spare], axis=1)
    _shade(bump, calibration.deepest, sensor.pitch, x, y, shading, degrees, calibration.steepest, image)
    for shadow in calibration.shadows:
        angle = np.deg2rad(shadow.direction)
        shade = shade_depth(bump, sensor.pitch, direction=angle, slope=shadow.slope, highest=calibration.deepest)
        _cast(np.ascontiguousarray(shade), MM * np.array(shadow.gain), image)
    return image


@compiled
def _cast(shade: Array, gain: Array, image: Array) -> None:
    """Add a shade (rows, cols), m, times the gain of each colour, levels per m, to an image (rows, cols, 3)."""
    for row in range(len(shade)):
        for col, depth in enumerate(shade[row]):
            for channel in range(3 if depth > 0 else 0):
                image[row, col, channel] += depth * gain[channel]


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
    deepest: float,  # that was fitted, m
    pitch: tuple[float, float],  # along y and x, m
    x: Array,  # (cols,) sensor widths
    y: Array,  # (rows,) sensor widths
    shading: Array,  # (3, terms of the normal, then the depth, then zeros up to a multiple of `TERMS_AT_ONCE`; terms of the position)
    degrees: tuple[int, int],  # in the normal and in the position
    steepest: float,
    image: Array,  # (rows, cols, 3) changed in place
) -> None:
    """Add the change of colours at every pixel that is drawn in or next to one that is, row by row."""
    rows, cols = bump.shape
    terms, light, factors = np.zeros((shading.shape[1], cols)), np.empty(cols), np.empty(shading.shape[1])
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
        _fill_normals(bump[row], bump[above], bump[below], pitch[1], (below - above) * pitch[0], steepest, terms)
        _fill_powers(degrees[0], bump[row], deepest, terms)
        total, across = light[first : last + 1], x[first : last + 1]
        for channel in range(3):
            total[:] = 0.0
            for i in range(degrees[1], -1, -1):  # Horner's rule in x; the coefficients are polynomials in y
                for term in range(shading.shape[1]):
                    factors[term] = 0.0
                    for j in range(degrees[1] - i, -1, -1):
                        factors[term] = factors[term] * y[row] + shading[channel, term, (i + j) * (i + j + 1) // 2 + j]
                for n in range(len(total)):
                    total[n] *= across[n]
                for k in range(0, len(factors), TERMS_AT_ONCE):
                    _add_five(terms, factors, k, first, total)
            for n in range(len(total)):
                image[row, first + n, channel] += total[n]


@compiled
def _fill_normals(here: Array, above: Array, below: Array, pitch: float, rise: float, steepest: float, terms: Array) -> None:
    """Compute how far the normals of a row (cols,) lean along x and y, at most as the steepest: the first two terms (terms, cols)."""
    last, normals_x, normals_y = len(here) - 1, terms[0], terms[1]
    across, along, limit = 0.5 / pitch, 1 / rise, 1 / (steepest * steepest)
    normals_x[0], normals_x[last] = (here[1] - here[0]) / pitch, (here[last] - here[last - 1]) / pitch
    for col in range(1, last):
        normals_x[col] = (here[col + 1] - here[col - 1]) * across
    for col in range(last + 1):
        slope_x, slope_y = normals_x[col], (below[col] - above[col]) * along
        squared = slope_x * slope_x + slope_y * slope_y
        share = 1 / np.sqrt(squared * limit if squared * limit > 1.0 + squared else 1.0 + squared)
        normals_x[col], normals_y[col] = slope_x * share, slope_y * share


@compiled
def _fill_powers(highest: int, bump: Array, deepest: float, terms: Array) -> None:
    """Compute the terms of the normal, up to a degree, from the first two, and the depth's after them."""
    number = 2
    for degree in range(2, highest + 1):  # each term is one of the degree before times nx, the last times ny
        for k in range(degree + 1):
            factor, source, into = terms[0 if k < degree else 1], terms[number - degree + min(k, degree - 1)], terms[number + k]
            for col in range(len(into)):
                into[col] = factor[col] * source[col]
        number += degree + 1
    into = terms[number]
    for col in range(len(into)):
        into[col] = bump[col] if bump[col] < deepest else deepest


@compiled
def _add_five(terms: Array, factors: Array, k: int, first: int, total: Array) -> None:
    """Add five terms (terms, cols), from the k-th on, times their factors (terms,), in a part of the columns."""
    end = first + len(total)
    a, b, c, d, e = terms[k, first:end], terms[k + 1, first:end], terms[k + 2, first:end], terms[k + 3, first:end], terms[k + 4, first:end]
    p, q, r, s, t = factors[k], factors[k + 1], factors[k + 2], factors[k + 3], factors[k + 4]
    for n in range(len(total)):
        total[n] += p * a[n] + q * b[n] + r * c[n] + s * d[n] + t * e[n]
