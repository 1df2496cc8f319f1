"""Read shear, force and torque of an elastic gel from the motion of dots that are printed on it: the traction that explains it best.

Valid range: that of `friction`. Components are along x and y of the sensor frame.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Floats, Mask
from pipeline.kernels.touch.depth_maps import gel_under, normal_force
from pipeline.kernels.touch.elastic_contact import cell_means, check_layer, contact_cells, refine
from pipeline.kernels.touch.friction import force_and_torque, on_pixels
from pipeline.kernels.touch.marker_tracking import MarkerTracker
from pipeline.kernels.touch.markers import dot_displacement
from pipeline.kernels.touch.sensor import Gel, Sensor
from pipeline.kernels.touch.shear_layer import shear_displacement

POWERS = tuple((across, total - across) for total in range(3) for across in range(total + 1))  # of x and y
RIDGE = 0.01  # weight of the mean square of traction over pressure, of that of the dots
LEAST_DOTS = 6  # half as many measured components as the traction has coefficients
STILL = 2e-5  # m, root mean square, that dots move by when nothing shears the gel: errors of tracking
UNEXPLAINED = 0.5  # share of the dots' motion from which a pressure cannot be what moved them
SLIDING = 0.75  # share of the friction from which half of a contact slides: the best for simulated slides


class ReadShear(NamedTuple):
    """The shear of a gel that its dots show; all zeros where nothing presses on it."""

    displacement: Array  # (rows, cols, 2) of the gel's surface from its rest, m
    traction: Array  # (rows, cols, 2) of the object on the gel, Pa
    pressure: Array  # (rows, cols) Pa, as given
    force: Array  # (3,) N of the object on the gel; z, out of the gel, is the sum of the pressure, and 0 or below
    torque: float  # N m about the sensor's axis, +z
    misfit: float  # m, root mean square: the motion of the dots, along either axis, that this shear does not explain
    explained: bool  # whether the pressure can be what moved the dots; if not, an even one over the whole gel is assumed for them

    @property
    def friction(self) -> float:
        """The coefficient of friction that this shear needs at least, in the mean over the contact; NaN where the pressure is not known."""
        total = float(self.pressure.sum())
        return float(np.hypot(*np.moveaxis(self.traction, -1, 0)).sum()) / total if self.explained and total > 0 else math.nan


def sliding(
    normal: Array,  # (N,) N, normal forces of a sequence
    friction: Array,  # (N,) what each step needs, NaN where it is not known
) -> tuple[float, Mask]:  # NaN if not known; (N,)
    """Find the friction, as the most that a sequence needs in steps of half its greatest force or more, and where a contact slides."""
    known = np.isfinite(friction) & (normal >= normal.max(initial=0.0) / 2)
    greatest = friction[known].max() if known.any() else math.nan
    return float(greatest), friction > SLIDING * greatest


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
        even = _explain(np.ones_like(pressure), positions[seen], moved[seen], sensor)
        return even._replace(pressure=pressure, force=np.array([*even.force[:2], shear.force[2]]), explained=False)
    return shear


def _explain(pressure: Array, positions: Array, moved: Array, sensor: Sensor) -> ReadShear:
    """Fit the quadratic function by least squares, regularised by the mean square of the ratio of traction and pressure."""
    assert isinstance(sensor.gel, Gel)
    factor, pitch = contact_cells(sensor)
    load = cell_means(np.ascontiguousarray(pressure, np.float64), factor) * (1 - sensor.gel.poisson**2) / sensor.gel.modulus
    if not load.any():
        nothing = np.zeros((*sensor.shape, 2))
        return ReadShear(nothing, nothing, pressure, np.zeros(3), 0.0, float(np.sqrt(np.mean(np.square(moved)))), explained=True)
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
    force, torque = force_and_torque(traction, sensor)
    force = np.array([*force, -normal_force(pressure, sensor)])
    return ReadShear(free + np.tensordot(coefficients, moves, 1), traction, pressure, force, torque, misfit, explained=True)


def _terms(load: Array, pitch: tuple[float, float]) -> Array:  # (6, rows, cols)
    """Evaluate the terms of a quadratic function, of the position in standard deviations of a load (rows, cols) from its middle."""
    y, x = (size * np.arange(count, dtype=np.float64) for count, size in zip(load.shape, pitch, strict=True))
    y, x = np.broadcast_arrays(y[:, None], x[None])
    y, x = (part - np.average(part, weights=load) for part in (y, x))
    size = max(np.sqrt(np.average(x**2 + y**2, weights=load)), min(pitch))
    return np.stack([(x / size) ** across * (y / size) ** down for across, down in POWERS])


@dataclass(frozen=True, eq=False)
class SlidDots:
    """The dots of a gel in a photograph, and what their motion shows."""

    positions: Array  # (M, 2) x and y from the gel's middle, m, of the dots at rest
    moved: Array  # (M, 2) m; NaN for dots that are lost
    shear: ReadShear

    def __str__(self) -> str:
        """Say forces, and what is amiss."""
        x, y, z = self.shear.force + 0.0  # no -0
        lost = int(np.isnan(self.moved[:, 0]).sum())
        said = f"force {x:.3f} {y:.3f} {z:.3f} N, torque {1e3 * self.shear.torque:.2f} mN·m, dots within {1e6 * self.shear.misfit:.0f} µm"
        said += f"; {lost} of {len(self.moved)} dots lost" if lost else ""
        even = "; what moves the dots does not show in the photograph: the whole gel is taken for pressed, the normal force is not known"
        return said if self.shear.explained else said + even


class DotReader:
    """Reads the photographs of a slide, one after the other."""

    def __init__(self, untouched: NDArray[np.uint8], sensor: Sensor) -> None:  # (rows, cols, 3); with its pixels
        if sensor.gel is None:
            raise InvalidInput(
                f"sensor {sensor.name} has no elastic gel, which shear and forces need; add `gel: {{modulus: …}}` to its file"
            )
        check_layer(sensor)
        self.sensor, self.tracker = sensor, MarkerTracker(untouched)
        self.positions = (self.tracker.positions + 0.5 - np.array(sensor.shape[::-1]) / 2) * sensor.pitch[::-1]

    def read(self, photograph: NDArray[np.uint8], pressed: Floats) -> SlidDots:  # (rows, cols, 3); (rows, cols) m, of the object in the gel
        """Read the next photograph."""
        moved = self.tracker.follow(photograph) * self.sensor.pitch[::-1]
        pressure = np.asarray(gel_under(pressed.astype(np.float64), self.sensor).pressure)
        return SlidDots(self.positions, moved, read_shear(pressure, self.positions, moved, self.sensor))
