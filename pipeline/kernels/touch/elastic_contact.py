"""Contact of a rigid object with an elastic gel, a layer on a rigid plate: pressure, contact area and the surface around it, no friction.

Valid range: impressions that are small beside the gel's thickness; slopes well below 1, as linear elasticity has it.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Mask
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.elastic_layer import WAVES, influence, layer_factor
from pipeline.kernels.touch.sensor import Gel, Sensor

MAX_CELLS = 160  # along the longer side of an image, on which contact is solved; with more pixels, several share a cell
TOLERANCE = 1e-4  # root mean square of the gap in the contact over the deepest impression; the force errs by as much
PEAK = 4  # largest gap in the contact, in tolerances; around the contact, where the object comes through, it is one
MAX_STEPS = 300  # seven times the most that any of 2800 random presses into random gels has needed
MARGIN = 2  # cells between the opposite rims of a window in `periodic_waves`
Layer = tuple[tuple[float, float], float, float]  # an elastic layer: size of a cell along y and x, m; Poisson's ratio; thickness, m
FIRST_LENGTH = 0.6  # of a step; stiffness times displacement is from 0.9 to 2, except in very thin layers


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
    coarse = cell_means(pressed, factor)
    deepest = coarse.max()
    if not deepest > 0:
        return PressedGel(np.zeros(sensor.shape), np.zeros(sensor.shape, bool), np.zeros(sensor.shape))
    check_layer(sensor)
    layer = pitch, gel.poisson, sensor.layer_thickness
    window = tuple(slice(at[0], at[-1] + 1) for at in (np.flatnonzero(coarse.any(axis=axis)) for axis in (1, 0)))
    share = (coarse[window] / deepest).astype(np.float32)
    window_pressure, indentation = _solve(share, _displacement(share.shape, coarse.shape, layer), _stiffness(share.shape, layer))
    unit_pressure = np.zeros(coarse.shape, np.float32)  # of a gel whose plane-strain modulus is 1 Pa, per m of the deepest impression
    unit_pressure[window] = window_pressure
    if share.shape != coarse.shape:
        indentation = _displacement(coarse.shape, coarse.shape, layer)(unit_pressure)
    surface, pressure = indentation * deepest, unit_pressure * (deepest * gel.modulus / (1 - gel.poisson**2))
    if factor > 1:
        surface, pressure = refine(surface, factor, sensor.shape), _spread(pressure, factor, pressed)
    surface = np.where(pressed > 0, np.maximum(surface, pressed), surface)
    return PressedGel(surface, pressure > 0, pressure)


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


@compiled
def cell_means(pressed: Array, factor: int) -> Array:
    """Average squares of pixels; beyond the rim, where nothing is known to press, the impression is 0."""
    rows, cols = pressed.shape
    means = np.zeros((-(-rows // factor), -(-cols // factor)))
    for row in range(rows):
        line, into = pressed[row], means[row // factor]
        for part in range(factor):
            for cell in range((cols - part + factor - 1) // factor):
                into[cell] += line[cell * factor + part]
    return means / factor**2


class _Convolution(NamedTuple):
    """A convolution in single precision by a kernel that is symmetric along both axes: `convolution(array)`, both (rows, cols)."""

    padded: tuple[int, int]  # rows and columns of the periodic grid
    spectrum: Array32  # (padded rows, padded columns // 2 + 1) of the kernel

    def __call__(self, array: Array32) -> Array32:
        waves = to_waves(array, self.padded)
        waves *= self.spectrum
        return from_waves(waves, self.padded, array.shape)


def to_waves(arrays: Array32, padded: tuple[int, int]) -> NDArray[np.complex64]:  # (..., padded rows, padded columns // 2 + 1)
    """Transform arrays (..., rows, cols) that zeros pad, axis by axis: lines of zeros need no transform."""
    return np.asarray(scipy.fft.fft(scipy.fft.rfft(arrays, padded[1]), padded[0], axis=-2))


def from_waves(waves: NDArray[np.complex64], padded: tuple[int, int], shape: tuple[int, ...]) -> Array32:  # (..., rows, cols)
    """Transform waves, which are overwritten, back to arrays whose last axes are those of `shape`; the rest is cut off."""
    lines = scipy.fft.ifft(waves, axis=-2, overwrite_x=True)[..., : shape[-2], :]
    return np.asarray(scipy.fft.irfft(lines, padded[1])[..., : shape[-1]])


@lru_cache(maxsize=8)
def _displacement(window: tuple[int, int], grid: tuple[int, int], layer: Layer) -> _Convolution:
    """Compute the displacements of a pressure in a window of a grid, without wrapping around."""
    rows, cols = (scipy.fft.next_fast_len(count, real=True) for count in window)
    kernel = np.zeros((rows + 1, cols + 1), np.float32)
    kernel[: window[0], : window[1]] = influence(grid, *layer)[: window[0], : window[1]]
    spectrum = scipy.fft.dctn(kernel, type=1)  # of the kernel and its mirror images
    return _Convolution((2 * rows, 2 * cols), np.concatenate([spectrum, spectrum[-2:0:-1]]))


def periodic_waves(
    window: tuple[int, int],  # rows and columns
    pitch: tuple[float, float],  # size of a cell along y and x, m
) -> tuple[tuple[int, int], Array, Array, Array]:
    """Pad a window with a margin between its rims; return rows and columns, and its waves: numbers along y and x, and lengths, 1/m."""
    padded = (scipy.fft.next_fast_len(window[0] + MARGIN, real=True), scipy.fft.next_fast_len(window[1] + MARGIN, real=True))
    y, x = (2 * np.pi * scipy.fft.fftfreq(count, size) for count, size in zip(padded, pitch, strict=True))
    y, x = np.broadcast_arrays(y[:, None], np.abs(x[None, : padded[1] // 2 + 1]))
    wave = np.sqrt(np.square(y) + np.square(x))
    wave[0, 0] = np.pi / max(count * size for count, size in zip(window, pitch, strict=True))  # a single contact is not infinite
    return padded, y, x, wave


@lru_cache(maxsize=8)
def _stiffness(window: tuple[int, int], layer: Layer) -> _Convolution:
    """Compute the approximate inverse of `_displacement`, which preconditions the solver: periodic, with a margin between the rims."""
    pitch, poisson, thickness = layer
    padded, _, _, wave = periodic_waves(window, pitch)
    knots = WAVES * np.linspace(0, 1, 200) ** 3  # a table is exact enough, and faster
    factor = np.interp(wave * thickness, knots, layer_factor(knots, poisson))
    return _Convolution(padded, (wave / (2 * factor)).astype(np.float32))


def _solve(pressed: Array32, displacement: _Convolution, stiffness: _Convolution) -> tuple[Array32, Array32]:
    """Find the pressure, and the surface under it, by spectral projected gradients (Birgin, Martínez and Raydan 2000), preconditioned.

    Cells whose pressure would become negative leave the contact; cells where the object comes through the gel's surface join it.
    """
    pressure, surface, change, gap = np.zeros((4, *pressed.shape), np.float32)
    length = FIRST_LENGTH
    for _ in range(MAX_STEPS):
        error, through, progress, curvature = _look(surface - pressed, pressed, pressure, change, gap)
        if max(error, through) < TOLERANCE:
            return pressure, surface
        if progress > 0 and curvature > 0:
            length *= progress / curvature
        _advance(stiffness(gap), np.float32(length), gap, pressure, change)
        surface = displacement(pressure)
    raise ArithmeticError(f"the contact of {int((pressed > 0).sum())} cells has not settled after {MAX_STEPS} steps")


@compiled
def _look(height: Array32, pressed: Array32, pressure: Array32, change: Array32, gap: Array32) -> tuple[float, float, float, float]:
    """Set the gap in the contact, 0 outside, to the surface's height over the object.

    Return the gap's root mean square; the largest of the depths by which the object comes through the surface and of the gap's `PEAK`th
    part; and two products of the last change of pressure: with the gap before, negated, and with the change of the gap. Sums are taken by
    columns, in short loops, which the compiler vectorises.
    """
    rows, cols = pressed.shape
    zero, one, share = np.float32(0), np.float32(1), np.float32(1 / PEAK)
    squares, cells, through, progress, curvature = np.zeros((5, cols), np.float32)
    for row in range(rows):
        now, depth, force, moved, kept = height[row], pressed[row], pressure[row], change[row], gap[row]
        for col in range(cols):
            progress[col] -= moved[col] * kept[col]
        for col in range(cols):
            curvature[col] += moved[col] * (now[col] - kept[col])
        for col in range(cols):
            kept[col] = now[col] if (force[col] > zero) | ((depth[col] > zero) & (now[col] < zero)) else zero
        for col in range(cols):
            squares[col] += kept[col] * kept[col]
            cells[col] += one if kept[col] != zero else zero
        for col in range(cols):
            worst = share * abs(kept[col]) if force[col] > zero else -kept[col]
            through[col] = worst if worst > through[col] else through[col]
    return np.sqrt(squares.sum() / max(cells.sum(), one)), through.max(), progress.sum(), curvature.sum()


@compiled
def _advance(step: Array32, length: np.float32, gap: Array32, pressure: Array32, change: Array32) -> None:
    """Move the pressure in the contact along a step, to 0 at least."""
    rows, cols = pressure.shape
    zero = np.float32(0)
    for row in range(rows):
        force, moved, along, kept = pressure[row], change[row], step[row], gap[row]
        for col in range(cols):
            moves = (force[col] > zero) | (kept[col] < zero)
            after = force[col] - length * along[col] if moves else zero
            after = after if after > zero else zero
            moved[col] = after - force[col]
            force[col] = after


@compiled
def _spread(cells: Array, factor: int, pressed: Array) -> Array:
    """Spread the pressure on each cell over its pixels that are pressed: falling to the lesser neighbour, with the cell's force."""
    (rows, cols), (last_row, last_col) = cells.shape, pressed.shape
    pressure = np.zeros(pressed.shape)
    for row in range(rows):
        for col in range(cols):
            here = cells[row, col]
            if here == 0:
                continue
            slope_y = _slope(cells[max(row - 1, 0), col], here, cells[min(row + 1, rows - 1), col]) / factor
            slope_x = _slope(cells[row, max(col - 1, 0)], here, cells[row, min(col + 1, cols - 1)]) / factor
            top, left, total = row * factor, col * factor, 0.0
            bottom, right = min(top + factor, last_row), min(left + factor, last_col)
            for y in range(top, bottom):
                start = here + (y - top + 0.5 - factor / 2) * slope_y + (0.5 - factor / 2) * slope_x
                for x in range(left, right):
                    if pressed[y, x] > 0:
                        pressure[y, x] = start + (x - left) * slope_x
                        total += pressure[y, x]
            share = here * factor**2 / total
            for y in range(top, bottom):
                for x in range(left, right):
                    pressure[y, x] *= share
    return pressure


@compiled
def _slope(before: float, here: float, after: float) -> float:
    """Compute the lesser of two differences, 0 at a peak: no new ones."""
    down, up = here - before, after - here
    return max(min(down, up), 0.0) + min(max(down, up), 0.0)


def refine(coarse: Array, factor: int, shape: tuple[int, int]) -> Array:
    """Interpolate by cubics through the middles of cells, each of which becomes factor x factor pixels; cut to a shape."""
    shares = (np.arange(factor) + 0.5) / factor - 0.5
    t = shares % 1  # of the way from the second to the third of four neighbours, weighted as Catmull and Rom do
    weights = np.stack(
        [t * (-0.5 + t * (1 - t / 2)), 1 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2 - 1.5 * t)), t * t * (-0.5 + t / 2)], axis=1
    )
    for _ in range(2):  # beyond the first and last cells, along a line
        coarse = np.pad(coarse, 1, mode="reflect", reflect_type="odd")
    fine = np.empty(shape)
    _refine_rows(coarse, np.floor(shares).astype(np.int64), weights, fine)
    return fine


@compiled
def _refine_rows(padded: Array, starts: NDArray[np.int64], weights: Array, fine: Array) -> None:
    """Interpolate between rows, then between columns, of cells with two more on every side."""
    factor, line = len(starts), np.empty(padded.shape[1])
    for row in range(fine.shape[0]):
        into, line[:] = fine[row], 0.0
        for k in range(4):
            cells, weight = padded[row // factor + starts[row % factor] + 1 + k], weights[row % factor, k]
            for col in range(len(line)):
                line[col] += weight * cells[col]
        for part in range(factor):
            at, share = line[starts[part] + 1 :], weights[part]
            for cell in range((len(into) - part + factor - 1) // factor):
                into[cell * factor + part] = (
                    share[0] * at[cell] + share[1] * at[cell + 1] + share[2] * at[cell + 2] + share[3] * at[cell + 3]
                )
