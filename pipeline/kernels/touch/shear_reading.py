"""Read shear, force and torque of an elastic gel from the motion of dots that are printed on it: the traction that explains it best.

Valid range: that of `friction`. Components are along x and y of the sensor frame.
"""

from typing import NamedTuple

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.elastic_contact import cell_means, contact_cells, refine
from pipeline.kernels.touch.friction import force_and_torque, on_pixels
from pipeline.kernels.touch.markers import dot_displacement
from pipeline.kernels.touch.sensor import Gel, Sensor
from pipeline.kernels.touch.shear_layer import shear_displacement

POWERS = tuple((across, total - across) for total in range(3) for across in range(total + 1))  # of x and y
RIDGE = 0.01  # weight of the mean square of traction over pressure, of that of the dots
LEAST_DOTS = 6  # half as many measured components as the traction has coefficients
STILL = 2e-5  # m, root mean square, that dots move by when nothing shears the gel: errors of tracking
UNEXPLAINED = 0.5  # share of the dots' motion from which a pressure cannot be what moved them


class ReadShear(NamedTuple):
    """The shear of a gel, as its dots tell it; all zeros where nothing presses on it."""

    displacement: Array  # (rows, cols, 2) of the gel's surface from its rest, m
    traction: Array  # (rows, cols, 2) of the object on the gel, Pa
    force: Array  # (2,) N, the sum of the traction
    torque: float  # N m about the sensor's axis, +z
    misfit: float  # m, root mean square: the motion of the dots, along either axis, that this shear does not explain
    explained: bool  # whether the pressure can be what moved the dots; if not, an even one over the whole gel is assumed


def read_shear(
    pressure: Array,  # (rows, cols) Pa: where it is counts, not how large it is
    positions: Array,  # (M, 2) m from the gel's middle, of the dots at rest
    moved: Array,  # (M, 2) m; NaN for dots that were not seen
    sensor: Sensor,  # with an elastic gel
) -> ReadShear:
    """Find the traction that moves dots as they were seen to move: the pressure times a quadratic function of the position.

    Pressure also moves the dots by itself. If it explains less than half of their motion, something flat touches that no image shows.
    """
    seen = np.isfinite(moved).all(axis=1)
    if seen.sum() < LEAST_DOTS:
        raise InvalidInput(f"{seen.sum()} of {len(moved)} dots are seen, {LEAST_DOTS} are needed to tell how the gel is sheared")
    size = float(np.sqrt(np.mean(np.square(moved[seen]))))
    shear = _explain(pressure, positions[seen], moved[seen], sensor)
    if size > STILL and shear.misfit > UNEXPLAINED * size:
        return _explain(np.full_like(pressure, STILL), positions[seen], moved[seen], sensor)._replace(explained=False)
    return shear


def _explain(pressure: Array, positions: Array, moved: Array, sensor: Sensor) -> ReadShear:
    """Fit the quadratic function by least squares, regularised by the mean square of the ratio of traction and pressure."""
    assert isinstance(sensor.gel, Gel)
    factor, pitch = contact_cells(sensor)
    load = cell_means(np.ascontiguousarray(pressure, np.float64), factor) * (1 - sensor.gel.poisson**2) / sensor.gel.modulus
    if not load.any():
        nothing = np.zeros((*sensor.shape, 2))
        return ReadShear(nothing, nothing, np.zeros(2), 0.0, float(np.sqrt(np.mean(np.square(moved)))), explained=True)
    terms, still = _terms(load, pitch), np.zeros_like(load)
    displace = shear_displacement(load.shape, load.shape, (pitch, sensor.gel.poisson, sensor.layer_thickness))
    cells = [displace(np.stack([still, still]), load)]
    for term in terms:
        cells += [displace(np.stack([term * load, still])), displace(np.stack([still, term * load]))]
    free, *moves = (np.stack([refine(part, factor, sensor.shape) if factor > 1 else part for part in cell], axis=-1) for cell in cells)
    free_dots, *dots = (dot_displacement(positions, surface, sensor.pitch).ravel() for surface in (free, *moves))
    matrix, target = np.stack(dots, axis=1), moved.ravel() - free_dots
    squares = np.kron(np.einsum("kij,lij,ij->kl", terms, terms, load) / load.sum(), np.eye(2))  # of the ratio, in the mean over the load
    normal = matrix.T @ matrix
    weight = RIDGE * np.trace(normal) / len(normal)
    coefficients, *_ = np.linalg.lstsq(normal + weight * squares, matrix.T @ target)  # a contact may be a point or a line
    traction = on_pixels(np.einsum("kc,kij->cij", coefficients.reshape(-1, 2), terms), sensor) * pressure[..., None]
    misfit = float(np.sqrt(np.mean(np.square(matrix @ coefficients - target))))
    return ReadShear(free + np.tensordot(coefficients, moves, 1), traction, *force_and_torque(traction, sensor), misfit, explained=True)


def _terms(load: Array, pitch: tuple[float, float]) -> Array:  # (6, rows, cols)
    """Evaluate the terms of a quadratic function, of the position in standard deviations of a load (rows, cols) from its middle."""
    y, x = (size * np.arange(count, dtype=np.float64) for count, size in zip(load.shape, pitch, strict=True))
    y, x = np.broadcast_arrays(y[:, None], x[None])
    y, x = (part - np.average(part, weights=load) for part in (y, x))
    size = max(np.sqrt(np.average(x**2 + y**2, weights=load)), min(pitch))
    return np.stack([(x / size) ** across * (y / size) ** down for across, down in POWERS])
