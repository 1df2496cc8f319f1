"""Coulomb friction between a rigid object that moves and an elastic gel: traction, displacement of its surface, stick and slip.

Valid range: that of `elastic_contact`, and displacements that are small beside the contact. Friction does not change the pressure. There is
one coefficient, for stick and slip, at any speed. Components are along x and y of the sensor frame.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Floats, Mask
from pipeline.kernels.compiled import compiled
from pipeline.kernels.geometry.transforms import invert_pose
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.elastic_contact import MARGIN, Layer, PressedGel, cell_means, contact_cells, from_waves, refine, to_waves
from pipeline.kernels.touch.elastic_layer import WAVES
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres
from pipeline.kernels.touch.shear_layer import shear_influence, wave_factors

MAX_FRICTION = 1000.0  # coefficient: more than any gel's, and little else than one that never slips
FRICTIONLESS = 1e-9  # coefficient below which there is no traction
TOLERANCE = 1e-4  # of displacements in the contact, root mean square, over the largest: the force errs by as much
MAX_STEPS = 100  # of the solver; four times the most that any of 2000 steps of random shapes and gels has needed
RIM = np.float32(1 - 1e-6)  # share of the square of the greatest traction from which a cell is at its limit
SLIP = 1e-3  # share of the object's motion by which a cell slips at least: cells at their limit need not slide
BLOCK = 8  # cells by whose multiples the windows of contacts grow: so that few sizes are prepared


class FrictionState(NamedTuple):
    """What friction has done to a gel, on its `contact_cells`: the result of a step, and the start of the next."""

    traction: Array  # (2, rows, cols) of the object on the gel, Pa
    displacement: Array  # (2, rows, cols) of the gel's surface from its rest, m
    anchor: Array  # (2, rows, cols) the displacement that the surface keeps where it sticks, m
    slip: Array  # (2, rows, cols) by which the object slid over the surface in the step, m; 0 where it sticks and outside the contact
    settled: bool = True  # False if the solver ended before it reached its tolerance


def gel_at_rest(sensor: Sensor) -> FrictionState:
    """Make the state of a gel that nothing has sheared."""
    factor, _ = contact_cells(sensor)
    return FrictionState(*np.zeros((4, 2, *(-(-count // factor) for count in sensor.shape))))


def object_motion(
    depth: Floats,  # (rows, cols) now, m
    before: Array,  # (4, 4) pose of the sensor in the object's frame, m
    now: Array,  # (4, 4)
    sensor: Sensor,
) -> Array:  # (3, rows, cols of cells) sensor frame, m
    """Compute how far the points of an object that now lie over the cells of a gel have moved; in the gel's surface where none does."""
    factor, _ = contact_cells(sensor)
    x, y = (centres[::factor] + (factor - 1) / 2 * size for centres, size in zip(pixel_centres(sensor), sensor.pitch[::-1], strict=True))
    surface = np.broadcast_to(gel_surface(sensor), sensor.shape)
    height = surface[::factor, ::factor] - cell_means(np.maximum(surface - depth, 0.0), factor)
    points = np.stack([*np.broadcast_arrays(x[None], y[:, None]), height])
    back = np.eye(4) - invert_pose(before) @ now
    return np.tensordot(back[:3, :3], points, 1) + back[:3, 3, None, None]


def drag_gel(
    gel: PressedGel,  # now
    motion: Array,  # (2, rows, cols of cells) of the object since the state before, m
    before: FrictionState,
    sensor: Sensor,
    friction: float,  # coefficient, 0 to `MAX_FRICTION`
) -> FrictionState:
    """Move an object that a gel is pressed by, for one step (Kalker, Three-Dimensional Elastic Bodies in Rolling Contact, 1990).

    The surface would stick to the object: where the step began it was displaced by `anchor`, now by that and the motion. Pressure
    displaces it too. The traction q, |q| <= friction · pressure, minimises q·Aq/2 - q·(stuck - displaced by pressure), where A is
    `shear_influence`. Cells that join the contact later start from where the surface is.
    """
    factor, pitch = contact_cells(sensor)
    if not gel.contact.any():
        return gel_at_rest(sensor)
    assert isinstance(sensor.gel, Gel)
    assert gel.pressure is not None
    stiff = sensor.gel.modulus / (1 - sensor.gel.poisson**2)
    layer = Layer(pitch, sensor.gel.poisson, sensor.layer_thickness)
    pressure = cell_means(gel.pressure, factor) / stiff
    grid, stuck = pressure.shape, before.anchor + motion
    window = _window(pressure > 0)
    local = _response(pressure[window[1:]].shape, grid, layer)
    bound = friction * pressure[window[1:]]
    target = stuck[window] - local.pulled(pressure[window[1:]])
    traction, settled = np.zeros_like(stuck), True
    if friction >= FRICTIONLESS:
        traction[window], settled = _solve(target, bound, before.traction[window] / stiff, local, _stiffness(bound.shape, layer))
    whole = _response(grid, grid, layer)
    displacement = whole.sheared(traction) + whole.pulled(pressure)
    sticks = (pressure > 0) & (np.square(traction).sum(axis=0) < RIM * np.square(friction * pressure))
    gap = np.where((pressure > 0) & ~sticks, stuck - displacement, 0.0)
    least = max(SLIP * _longest(motion[:, pressure > 0]), TOLERANCE * _longest(displacement))
    slip = np.where(np.hypot(*gap) > least, gap, 0.0)
    return FrictionState(traction * stiff, displacement, np.where(sticks, stuck, displacement), slip, settled)


def check_step(motion: Array, touches: bool, sensor: Sensor) -> None:
    """Raise an `InvalidInput` if an object that touches moves (3, rows, cols of cells), m, by more than the gel's thickness."""
    farthest, thickness = _longest(motion), sensor.layer_thickness
    if touches and farthest > thickness:
        raise InvalidInput(
            f"the object moves by {farthest:.3g} m over the gel of sensor {sensor.name!r} from one pose to the next; while they touch, a "
            f"step is at most the gel's thickness, {thickness:.3g} m: put poses between them"
        )


def surface_displacement(state: FrictionState, sensor: Sensor) -> Array:  # (rows, cols, 2) m
    """Interpolate the displacement of a gel's surface between the middles of cells."""
    factor, _ = contact_cells(sensor)
    fine = state.displacement if factor == 1 else [refine(part, factor, sensor.shape) for part in state.displacement]
    return np.stack(fine, axis=-1)


def surface_traction(state: FrictionState, gel: PressedGel, sensor: Sensor) -> Array:  # (rows, cols, 2) Pa
    """Spread the traction of cells over their pixels, as the pressure is spread: the ratio of both is that of the cell."""
    factor, _ = contact_cells(sensor)
    pressure = cell_means(np.asarray(gel.pressure), factor)
    ratio = np.divide(state.traction, pressure, out=np.zeros_like(state.traction), where=pressure > 0)
    return on_pixels(ratio, sensor) * np.asarray(gel.pressure)[..., None]


def on_pixels(cells: Array, sensor: Sensor) -> Array:  # (rows, cols, ...)
    """Give pixels the value of their cell, of (..., rows, cols of cells)."""
    factor, _ = contact_cells(sensor)
    fine = cells if factor == 1 else cells.repeat(factor, axis=-2).repeat(factor, axis=-1)[..., : sensor.rows, : sensor.cols]
    return np.moveaxis(fine, (-2, -1), (0, 1))


def _longest(vectors: Array) -> float:
    """Compute the greatest length of vectors (n, ...)."""
    return float(np.sqrt(np.square(vectors).sum(axis=0).max(initial=0.0)))


def _window(contact: Mask) -> tuple[slice, slice, slice]:
    """Find the window of a contact; the first slice is of both components."""
    window = [slice(None)]
    for axis in (1, 0):
        at, count = np.flatnonzero(contact.any(axis=axis)), contact.shape[1 - axis]
        size = min(-(-(at[-1] - at[0] + 1) // BLOCK) * BLOCK, count)
        start = min(at[0], count - size)
        window.append(slice(start, start + size))
    return tuple(window)


class _Response(NamedTuple):
    """How the cells of a window move, without wrapping around; in single precision."""

    padded: tuple[int, int]  # rows and columns of the periodic grid
    shear: Array32  # (3, padded rows, padded columns // 2 + 1) spectra of xx, yy and xy
    pull: NDArray[np.complex64]  # (2, padded rows, padded columns // 2 + 1) of xp and yp
    largest: float  # eigenvalue, at most

    def sheared(self, traction: Floats) -> Array32:  # (2, rows, cols)
        """Compute the displacements by a traction (2, rows, cols)."""
        return _mixed(traction, self.padded, self.shear)

    def pulled(self, pressure: Floats) -> Array32:  # (2, rows, cols)
        """Compute the displacements by a pressure (rows, cols)."""
        waves = self.pull * to_waves(pressure.astype(np.float32), self.padded)
        return from_waves(waves, self.padded, pressure.shape)


@lru_cache(maxsize=16)
def _response(window: tuple[int, int], grid: tuple[int, int], layer: Layer) -> _Response:
    """Prepare the response of a window of a grid."""
    padded = tuple(2 * scipy.fft.next_fast_len(count, real=True) for count in window)
    kernels = np.zeros((5, *padded), np.float32)
    signs = (1, 1), (1, 1), (-1, -1), (1, -1), (-1, 1)  # of mirror images along y and x
    for kernel, quarter, (along_y, along_x) in zip(kernels, shear_influence(grid, *layer), signs, strict=True):
        rows, cols = window
        kernel[:rows, :cols] = quarter[:rows, :cols]
        kernel[padded[0] - rows + 1 :, :cols] = along_y * kernel[rows - 1 : 0 : -1, :cols]
        kernel[:, padded[1] - cols + 1 :] = along_x * kernel[:, cols - 1 : 0 : -1]
    waves = scipy.fft.rfft2(kernels)
    xx, yy, xy = shear = np.ascontiguousarray(waves[:3].real)
    return _Response(padded, shear, waves[3:], float(((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)).max()))


class _Stiffness(NamedTuple):
    """The approximate inverse of `_Response.sheared`, which preconditions the solver: periodic, with a margin between the rims."""

    padded: tuple[int, int]
    spectra: Array32  # (3, padded rows, padded columns // 2 + 1) of xx, yy and xy
    mean: np.float32  # diagonal entry


@lru_cache(maxsize=16)
def _stiffness(window: tuple[int, int], layer: Layer) -> _Stiffness:
    """Prepare the stiffness of a window."""
    padded = tuple(scipy.fft.next_fast_len(count + MARGIN, real=True) for count in window)
    y, x = (2 * np.pi * scipy.fft.fftfreq(count, size) for count, size in zip(padded, layer.pitch, strict=True))
    y, x = np.broadcast_arrays(y[:, None], np.abs(x[None, : padded[1] // 2 + 1]))
    wave = np.hypot(x, y)
    wave[0, 0] = np.pi / max(count * size for count, size in zip(window, layer.pitch, strict=True))
    knots = WAVES * np.linspace(0.001, 1, 200) ** 3  # a table is exact enough, and faster
    factors = wave_factors(knots, layer.poisson)
    along, across = (wave / (2 * np.interp(wave * layer.thickness, knots, factor)) for factor in factors[:2])
    along[0, 0] = across[0, 0] = min(along[0, 0], across[0, 0])  # a wave without direction
    spectra = np.stack([along * x**2 + across * y**2, along * y**2 + across * x**2, (along - across) * x * y]) / wave**2
    spectra[:2, 0, 0] = along[0, 0]
    return _Stiffness(padded, spectra.astype(np.float32), np.float32(spectra[:2].mean()))


def _mixed(vectors: Floats, padded: tuple[int, int], spectra: Array32) -> Array32:  # (2, rows, cols)
    """Multiply the waves of vectors (2, rows, cols) by symmetric matrices of spectra xx, yy and xy."""
    waves = to_waves(vectors.astype(np.float32, copy=False), padded)
    _mix(waves, spectra)
    return from_waves(waves, padded, vectors.shape)


@compiled
def _mix(waves: NDArray[np.complex64], spectra: Array32) -> None:
    for row in range(waves.shape[1]):
        x, y, xx, yy, xy = waves[0, row], waves[1, row], spectra[0, row], spectra[1, row], spectra[2, row]
        for col in range(len(x)):
            x[col], y[col] = xx[col] * x[col] + xy[col] * y[col], xy[col] * x[col] + yy[col] * y[col]


def _solve(target: Array, bound: Array, start: Array, response: _Response, stiffness: _Stiffness) -> tuple[Array, bool]:
    """Find the traction (2, rows, cols) and whether it settled: by preconditioned conjugate gradients on discs of radii `bound`.

    Cells on the rim of their disc that the gap pushes outwards slip: they move along the rim, whose curvature adds to the stiffness.
    """
    unit = bound.max()  # single precision holds small coefficients too
    radius, target, traction = ((array / unit).astype(np.float32) for array in (bound, target, start))
    normal, residual, direction = np.zeros((3, *target.shape), np.float32)
    curvature, weight = np.zeros((2, *radius.shape), np.float32)
    small, size, decrease = np.float32(1 / response.largest), 0.0, 1.0
    _clip(traction, radius, normal)
    moved = response.sheared(traction)
    size = np.abs(moved).max()
    traction -= small * (moved - target)  # without this step, cells that slip far would be taken for sticking
    _clip(traction, radius, normal)
    moved = response.sheared(traction)
    for _ in range(MAX_STEPS):
        size, before = max(size, np.abs(moved).max()), residual.copy()
        error = _look(traction, moved - target, radius, small, normal, curvature, residual)
        if error <= TOLERANCE * size:
            return traction * np.float64(unit), True
        weight = (radius > 0) / np.sqrt(1 + curvature * stiffness.mean)
        step = weight * _mixed(weight * residual, stiffness.padded, stiffness.spectra)
        _along_rims(step, normal)
        _along_rims(direction, normal)
        last, decrease = decrease, _dot(step, residual)
        direction *= np.float32(max(0.0, (decrease - _dot(step, before)) / last))
        direction += step
        yielding = response.sheared(direction)
        length = _dot(residual, direction) / _dot(direction, yielding + curvature * direction)
        traction -= np.float32(length) * direction
        _clip(traction, radius, normal)
        moved = response.sheared(traction)
    return traction * np.float64(unit), False


def _dot(one: Array32, other: Array32) -> float:
    return float((one * other).sum(dtype=np.float64))


@compiled
def _look(
    traction: Array32, gap: Array32, radius: Array32, small: np.float32, normal: Array32, curvature: Array32, residual: Array32
) -> float:
    """Find the cells that slip, their normal, else 0, and curvature, and the part of the gap that a step may close.

    Return the root mean square of what a small step along the gap changes, over that step: 0 for the solution.
    """
    squares, cells = 0.0, 0
    for row in range(radius.shape[0]):
        for col in range(radius.shape[1]):
            limit = radius[row, col]
            if limit == 0:
                continue
            x, y, gap_x, gap_y = traction[0, row, col], traction[1, row, col], gap[0, row, col], gap[1, row, col]
            step_x, step_y = x - small * gap_x, y - small * gap_y
            length = np.sqrt(step_x * step_x + step_y * step_y)
            share = limit / length if length > limit else np.float32(1)
            squares += (x - step_x * share) ** 2 + (y - step_y * share) ** 2
            cells += 1
            outwards = -(gap_x * x + gap_y * y) / limit
            slips = outwards >= 0 and x * x + y * y >= limit * limit * RIM
            normal[0, row, col] = x / limit if slips else np.float32(0)
            normal[1, row, col] = y / limit if slips else np.float32(0)
            curvature[row, col] = outwards / limit if slips else np.float32(0)
            residual[0, row, col], residual[1, row, col] = gap_x, gap_y
    _along_rims(residual, normal)
    return np.sqrt(squares / max(cells, 1)) / small


@compiled
def _along_rims(vectors: Array32, normal: Array32) -> None:
    """Take away the part of vectors (2, rows, cols) along normals, which are 0 where nothing slips."""
    for row in range(vectors.shape[1]):
        x, y, normal_x, normal_y = vectors[0, row], vectors[1, row], normal[0, row], normal[1, row]
        for col in range(len(x)):
            outwards = x[col] * normal_x[col] + y[col] * normal_y[col]
            x[col] -= outwards * normal_x[col]
            y[col] -= outwards * normal_y[col]


@compiled
def _clip(traction: Array32, radius: Array32, normal: Array32) -> None:
    """Shorten tractions to the radius of their disc; those that slip get its length."""
    for row in range(radius.shape[0]):
        for col in range(radius.shape[1]):
            x, y, limit = traction[0, row, col], traction[1, row, col], radius[row, col]
            length = np.sqrt(x * x + y * y)
            slips = normal[0, row, col] != 0 or normal[1, row, col] != 0
            if length > limit or (slips and length > 0):
                traction[0, row, col] *= limit / length
                traction[1, row, col] *= limit / length
