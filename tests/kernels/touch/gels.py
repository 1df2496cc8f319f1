"""Gels that a ball presses with Hertz's pressure, how an object moves over them, and the forces."""

import numpy as np

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.elastic_contact import PressedGel, cell_means, contact_cells
from pipeline.kernels.touch.friction import FrictionState
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres

E, RADIUS, FRICTION = 2e5, 0.002, 0.6
"""Young's modulus, Pa; radius of a contact, m; coefficient."""


def sensor(rows: int, cols: int, poisson: float = 0.5, thickness: float = 10.0, pitch: float = RADIUS / 20) -> Sensor:
    """Make a gel of square pixels; 10 m of it are a half-space."""
    size = {"width": pitch * cols, "given_height": pitch * rows, "rows": rows, "cols": cols, "w": 0.006, "membrane": 0.0}
    return load_sensor("gelsight").model_copy(update=size | {"gel": Gel(modulus=E, poisson=poisson, thickness=thickness)})


def shear_modulus(worn: Sensor) -> float:
    return E / (2 * (1 + worn.gel.poisson))


def hertz(worn: Sensor, radius: float = RADIUS, peak: float = 2e4) -> PressedGel:
    """Means over pixels of the pressure under a ball."""
    fine = worn.model_copy(update={"rows": 8 * worn.rows, "cols": 8 * worn.cols})
    x, y = pixel_centres(fine)
    pressure = peak * np.sqrt(np.maximum(1 - (x[None] ** 2 + y[:, None] ** 2) / radius**2, 0))
    pressure = cell_means(pressure, 8)
    return PressedGel(0 * pressure, pressure > 0, pressure)


def shift(state: FrictionState, x: float, y: float = 0.0, turn: float = 0.0, worn: Sensor | None = None) -> np.ndarray:
    """Motion of an object by x and y, m, and by a small turn about the middle."""
    motion = np.zeros((3, *state.contact.shape))
    motion[0], motion[1] = x, y
    if worn is not None:
        columns, rows = pixel_centres(worn)
        motion[0] -= turn * rows[:, None]
        motion[1] += turn * columns[None]
    return motion


def forces(state: FrictionState, worn: Sensor) -> np.ndarray:
    return state.traction.sum(axis=(1, 2)) * np.prod(contact_cells(worn)[1])


def torque(state: FrictionState, worn: Sensor) -> float:
    x, y = pixel_centres(worn)
    return float((x[None] * state.traction[1] - y[:, None] * state.traction[0]).sum() * np.prod(worn.pitch))
