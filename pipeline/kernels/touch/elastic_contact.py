"""Contact of a rigid object with an elastic gel, a layer on a rigid plate: pressure, contact area and the surface around it, no friction.

Valid range: impressions that are small beside the gel's thickness; slopes well below 1, as linear elasticity has it. A layer much thicker
than the grid is a half-space.
"""

from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Mask
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.sensor import Gel, Sensor

REACH = 30.0  # thicknesses from a load at which a layer no longer moves: less than 1e-9 of a half-space's displacement
KNOTS_PER_THICKNESS = 100
WAVES, NODES = 16.0, 400  # wave number times thickness from which a layer is a half-space to 1e-13; nodes of the quadrature
GAUSS = (-0.5 / 3**0.5, 0.5 / 3**0.5)  # nodes of a quadrature over a cell, in cells
MAX_CELLS = 160  # along the longer side of an image, on which contact is solved; with more pixels, several share a cell
TOLERANCE = 1e-4  # largest gap in the contact over the deepest impression; the force errs by as much
MAX_STEPS = 300  # ten times the most that any press has needed


@lru_cache(maxsize=8)
def influence(
    shape: tuple[int, int],  # rows and columns of the grid
    pitch: tuple[float, float],  # size of a cell along y and x, m
    poisson: float,  # 0 to 0.5
    thickness: float,  # of the layer, m
) -> Array:  # (rows, cols) m, read-only
    """Compute the displacements that a uniform pressure on one cell causes in the cells of a grid.

    [i, j] is the displacement into the layer in the middle of the cell i rows and j columns away, of a pressure of 1 Pa where the layer's
    plane-strain modulus E / (1 - poisson²) is 1 Pa. The base is bonded to a rigid plate, the surface is free of friction.

    The half-space's part is exact (Boussinesq's solution integrated over a rectangle; Love 1929). The layer's is the inverse Hankel
    transform of `layer_factor` - 1, which is smooth on the scale of the thickness.
    """
    y, x = (np.arange(count) * size for count, size in zip(shape, pitch, strict=True))
    bond = np.zeros(shape)
    for sign_y, sign_x in product(GAUSS, GAUSS):  # a mean over the cell
        distance = np.hypot(y[:, None] + sign_y * pitch[0], x[None] + sign_x * pitch[1]) / thickness
        bond += np.where(distance < REACH, _bond(poisson)(np.minimum(distance, REACH)), -1 / np.maximum(distance, REACH)) / 4
    displacement = _half_space(shape, pitch) + bond * (pitch[0] * pitch[1] / (np.pi * thickness))
    displacement.flags.writeable = False
    return np.asarray(displacement)


def layer_factor(wave: Floats, poisson: float) -> Array:  # (...) 0 to 1
    """Compute the displacement of a bonded layer under a wave of pressure, relative to a half-space's, 2 p / (q E / (1 - poisson²)).

    `wave` is the wave number times the thickness. In plane strain, on a rigid base, it is (Johnson, Contact Mechanics, 1985, 5.8)
    (2k sinh 2a - 4a) / (2k cosh 2a + 1 + k² + 4a²), k = 3 - 4 poisson, a = wave.
    """
    k, small = 3 - 4 * poisson, np.exp(-2 * np.asarray(wave, np.longdouble))  # extended: the same bits on every processor
    above = k * (1 - small**2) - 4 * wave * small
    return np.asarray(above / (k * (1 + small**2) + (1 + k**2 + 4 * np.square(wave)) * small), np.float64)


@lru_cache(maxsize=8)
def _bond(poisson: float) -> "scipy.interpolate.CubicSpline":
    """Compute the correction of a half-space's 1/r for the rigid base, by distance in thicknesses: the integral of (factor - 1) J0(a r)."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    wave, weights = (nodes + 1) * WAVES / 2, weights * WAVES / 2
    distance = np.linspace(0, REACH, int(REACH * KNOTS_PER_THICKNESS) + 1)
    weighted = weights * (layer_factor(wave, poisson) - 1)
    return scipy.interpolate.CubicSpline(distance, (scipy.special.j0(distance[:, None] * wave) * weighted).sum(axis=1))


@lru_cache(maxsize=8)
def _half_space(shape: tuple[int, int], pitch: tuple[float, float]) -> Array:
    """Integrate 1 / (pi r) over a cell, seen from the middles of the cells of a grid."""
    y, x = (np.arange(count, dtype=np.longdouble) * size for count, size in zip(shape, pitch, strict=True))
    total = np.zeros(shape, np.longdouble)
    for sign_y, sign_x in product((1, -1), (1, -1)):
        v, u = y[:, None] + sign_y * pitch[0] / 2, x[None] + sign_x * pitch[1] / 2
        total += sign_y * sign_x * (u * np.arcsinh(v / np.abs(u)) + v * np.arcsinh(u / np.abs(v)))
    return np.asarray(total / np.pi, np.float64)


class PressedGel(NamedTuple):
    """The surface of a gel, and where an object touches it."""

    indentation: Array  # (rows, cols) m: how deep it lies below its rest; negative where it rises
    contact: Mask  # (rows, cols) where the object touches it
    pressure: Array | None = None  # (rows, cols) Pa, of an elastic gel, 0 outside the contact; else None


def press_elastic(pressed: Array, sensor: Sensor, gel: Gel) -> PressedGel:
    """Press a rigid object of impression D' (rows, cols), m, into a sensor's elastic gel; nothing presses outside the image.

    Pressure p >= 0 minimises p·Gp/2 - p·D' over the cells with D' > 0, where G is `influence`: the gel's surface Gp is nowhere above the
    object, and meets it where p > 0. So the force, the derivative of a minimum by the depth, grows with the depth. Where images have more
    than `MAX_CELLS` per side, squares of pixels share a cell with their mean D', and what lies between is interpolated.
    """
    factor, pitch = contact_cells(sensor)
    coarse = _cell_means(pressed, factor)
    if not coarse.any():
        return PressedGel(np.zeros(sensor.shape), np.zeros(sensor.shape, bool), np.zeros(sensor.shape))
    check_layer(sensor)
    thickness = sensor.layer_thickness
    displacement = _grid_displacement(coarse.shape, pitch, gel.poisson, thickness)
    window = tuple(slice(at[0], at[-1] + 1) for at in (np.flatnonzero(coarse.any(axis=axis)) for axis in (1, 0)))
    pressed_window = coarse[window]
    unit_pressure = np.zeros_like(coarse)  # of a gel whose plane-strain modulus is 1 Pa
    unit_pressure[window] = _solve(
        pressed_window, displacement.restricted(pressed_window.shape), _Stiffness(pressed_window.shape, pitch, gel.poisson, thickness)
    )
    indentation, pressure = displacement(unit_pressure), unit_pressure
    if factor > 1:
        indentation, pressure = _refine(indentation, factor, sensor.shape), _spread(unit_pressure, pressed > 0, factor)
    surface = np.where(pressed > 0, np.maximum(indentation, pressed), indentation)
    return PressedGel(surface, pressure > 0, gel.modulus / (1 - gel.poisson**2) * pressure)


def contact_cells(sensor: Sensor) -> tuple[int, tuple[float, float]]:
    """Compute the pixels per side of the cells on which contact is solved, and the cells' height and width, m."""
    factor = -(-max(sensor.shape) // MAX_CELLS)
    return factor, (sensor.pitch[0] * factor, sensor.pitch[1] * factor)


def check_layer(sensor: Sensor) -> None:
    """Raise an `InvalidInput` if a sensor's elastic layer is thinner than the cells on which its contact is solved."""
    thickness, cell = sensor.layer_thickness, max(contact_cells(sensor)[1])
    if thickness < cell:
        raise InvalidInput(
            f"the elastic gel of sensor {sensor.name!r} is {thickness:.3g} m thick, its contact is solved on cells of {cell:.3g} m: "
            f"make the gel at least as thick, or, where an image has fewer than {MAX_CELLS} pixels per side, take more"
        )


def _cell_means(pressed: Array, factor: int) -> Array:
    """Average squares of pixels; beyond the rim, where nothing is known to press, the impression is 0."""
    if factor == 1:
        return pressed
    rows, cols = (-(-count // factor) for count in pressed.shape)
    padded = np.zeros((rows * factor, cols * factor))
    padded[: pressed.shape[0], : pressed.shape[1]] = pressed
    lines = padded.reshape(rows, factor, -1).sum(axis=1)
    return np.asarray(lines.reshape(rows, cols, factor).sum(axis=2) / factor**2)


class _Displacement:
    """The displacements of a pressure on a grid, without wrapping around: `displacement(pressure)`, both (rows, cols)."""

    def __init__(self, kernel: Array) -> None:
        rows, cols = self.shape = kernel.shape
        self.kernel = kernel
        self.padded = (scipy.fft.next_fast_len(2 * rows - 1), scipy.fft.next_fast_len(2 * cols - 1, real=True))
        wrapped = np.zeros(self.padded)
        wrapped[:rows, :cols] = kernel
        wrapped[self.padded[0] - rows + 1 :, :cols] = kernel[:0:-1]
        wrapped[:, self.padded[1] - cols + 1 :] = wrapped[:, cols - 1 : 0 : -1]
        self.spectrum = scipy.fft.rfft2(wrapped)

    def __call__(self, pressure: Array) -> Array:
        lines = scipy.fft.rfft(pressure, self.padded[1])  # axis by axis: lines of zeros and lines that are cut off need no transform
        waves = scipy.fft.fft(lines, self.padded[0], axis=0)
        waves *= self.spectrum
        lines = scipy.fft.ifft(waves, axis=0, overwrite_x=True)[: self.shape[0]]
        return np.ascontiguousarray(scipy.fft.irfft(lines, self.padded[1])[:, : self.shape[1]])

    def restricted(self, shape: tuple[int, ...]) -> "_Displacement":
        """Return the displacements on a smaller grid."""
        return self if shape == self.shape else _Displacement(self.kernel[: shape[0], : shape[1]])


@lru_cache(maxsize=8)
def _grid_displacement(shape: tuple[int, int], pitch: tuple[float, float], poisson: float, thickness: float) -> _Displacement:
    return _Displacement(influence(shape, pitch, poisson, thickness))


class _Stiffness:
    """The approximate inverse of `_Displacement` on a periodic grid, which preconditions the solver; in single precision."""

    def __init__(self, shape: tuple[int, int], pitch: tuple[float, float], poisson: float, thickness: float) -> None:
        rows, cols = self.padded = scipy.fft.next_fast_len(shape[0]), scipy.fft.next_fast_len(shape[1], real=True)
        waves = [2 * np.pi * frequencies for frequencies in (scipy.fft.fftfreq(rows, pitch[0]), scipy.fft.rfftfreq(cols, pitch[1]))]
        wave = np.hypot(waves[0][:, None], waves[1][None])
        wave[0, 0] = np.pi / max(shape[0] * pitch[0], shape[1] * pitch[1])  # a single contact is not infinite
        self.spectrum = (wave / (2 * layer_factor(wave * thickness, poisson))).astype(np.float32)

    def __call__(self, displacement: Array) -> Array:
        pressure = scipy.fft.irfft2(scipy.fft.rfft2(displacement.astype(np.float32), self.padded) * self.spectrum, self.padded)
        return np.asarray(pressure[: displacement.shape[0], : displacement.shape[1]], np.float64)


def _solve(pressed: Array, displacement: _Displacement, stiffness: _Stiffness) -> Array:
    """Find the pressure by projected conjugate gradients (Polonsky and Keer 1999; preconditioned as Vollebregt 2014).

    Cells whose pressure would become negative leave the contact; cells where the object comes through the gel's surface join it.
    """
    below = pressed > 0
    pressure = np.where(below, np.maximum(stiffness(pressed), 0), 0)
    if not pressure.any():
        pressure = pressed.copy()
    surface = displacement(pressure)
    pressure *= (scale := (pressed * pressure).sum() / (surface * pressure).sum())
    surface *= scale
    tolerance, direction, gap, steepness = TOLERANCE * pressed.max(), np.zeros_like(pressed), np.zeros_like(pressed), 0.0
    for _ in range(MAX_STEPS):
        previous_gap, gap = gap, surface - pressed
        through = below & (pressure == 0) & (gap < 0)
        contact = (pressure > 0) | through
        if np.sqrt(np.square(gap[contact]).mean()) < tolerance and not (gap[through] < -tolerance).any():
            return pressure
        step = np.where(contact, stiffness(np.where(contact, gap, 0)), 0)
        turn = max(0.0, float((step * (gap - previous_gap)).sum()) / steepness) if steepness else 0.0
        direction = np.where(contact, step + turn * direction, 0)
        change = displacement(direction)
        length = (gap * direction).sum() / (change * direction).sum()
        pressure = pressure - length * direction
        if through.any() or (pressure < 0).any():  # the contact has changed: restart the directions
            np.maximum(pressure, 0, out=pressure)
            surface, steepness = displacement(pressure), 0.0
        else:
            surface, steepness = surface - length * change, float((step * gap).sum())
    raise ArithmeticError(f"the contact of {int(below.sum())} cells has not settled after {MAX_STEPS} steps")


def _spread(pressure: Array, pressed: Mask, factor: int) -> Array:
    """Spread the pressure on each cell over its pixels that are pressed: falling to the lesser neighbour, with the cell's force."""
    offsets = (np.arange(factor) + 0.5) / factor - 0.5
    fine = np.repeat(np.repeat(pressure, factor, axis=0), factor, axis=1)
    for axis in (0, 1):
        edges = np.diff(pressure, axis=axis, prepend=np.take(pressure, [0], axis), append=np.take(pressure, [-1], axis))
        before, after = np.delete(edges, -1, axis), np.delete(edges, 0, axis)
        slope = np.where(before * after > 0, np.sign(after) * np.minimum(np.abs(before), np.abs(after)), 0)  # no new peaks
        steps = np.tile(offsets, pressure.shape[axis])
        fine += np.repeat(np.repeat(slope, factor, axis=0), factor, axis=1) * (steps[:, None] if axis == 0 else steps[None])
    rows, cols = pressed.shape
    fine = np.where(pressed, fine[:rows, :cols], 0)
    share = np.divide(pressure, _cell_means(fine, factor), out=np.zeros_like(pressure), where=pressure > 0)
    return np.asarray(fine * np.repeat(np.repeat(share, factor, axis=0), factor, axis=1)[:rows, :cols])


def _refine(coarse: Array, factor: int, shape: tuple[int, int]) -> Array:
    """Interpolate by cubics through the middles of cells, each of which becomes factor x factor pixels; cut to a shape."""
    shares = (np.arange(factor) + 0.5) / factor - 0.5
    t = shares % 1  # of the way from the second to the third of four neighbours, weighted as Catmull and Rom do
    weights = np.stack(
        [t * (-0.5 + t * (1 - t / 2)), 1 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2 - 1.5 * t)), t * t * (-0.5 + t / 2)], axis=1
    )
    starts = np.floor(shares).astype(np.int64)
    rows = _refine_rows(np.ascontiguousarray(coarse), factor, starts, weights)
    fine = _refine_rows(np.ascontiguousarray(rows.T), factor, starts, weights).T
    return np.ascontiguousarray(fine[: shape[0], : shape[1]])


@compiled
def _refine_rows(coarse: Array, factor: int, starts: NDArray[np.int64], weights: Array) -> Array:
    """Interpolate between rows; beyond the first and last one, along a line."""
    rows, cols = coarse.shape
    padded = np.empty((rows + 4, cols))
    padded[2 : rows + 2] = coarse
    for margin in (1, 2):
        for col in range(cols):
            padded[2 - margin, col] = coarse[0, col] + margin * (coarse[0, col] - coarse[min(1, rows - 1), col])
            padded[rows + 1 + margin, col] = coarse[rows - 1, col] + margin * (coarse[rows - 1, col] - coarse[max(rows - 2, 0), col])
    fine = np.empty((rows * factor, cols))
    for row in range(rows):
        for k in range(factor):
            first = row + starts[k] + 1
            for col in range(cols):
                total = 0.0
                for n in range(4):
                    total += weights[k, n] * padded[first + n, col]
                fine[row * factor + k, col] = total
    return fine
