"""The contact of a ball with a gel: its circle in a photograph, and the impression behind it.

Valid range: balls larger than their contacts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.pressed_gel import gel_under
from pipeline.kernels.touch.sensor import MM, Sensor, pixel_centres

RING = 3.0  # radius of the region around a contact that is fitted and compared, in contact radii
HALVINGS = 14  # halvings of the interval in which a ball's depth is searched: accurate to a ten-thousandth

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Circle:
    """A contact in an image, in pixels; the centre of pixel (0, 0) is (0, 0)."""

    x: float  # of the centre
    y: float
    radius: float


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph of a ball in the gel, and its contact."""

    name: str
    image: NDArray[np.uint8]  # (rows, cols, 3)
    contact: Circle


def ball_impression(
    sensor: Sensor,
    contact: Circle,  # its radius is one along x where pixels are not square
    ball_radius: float,  # m, more than the contact's
) -> Array:  # (rows, cols) m
    """Compute the impression of a ball from its circle of contact with the sensor's membrane or elastic gel."""
    reach = contact.radius * sensor.pitch[1]
    if reach >= ball_radius:
        raise ValueError(f"a contact of {MM * reach:.3g} mm radius is too large for a ball of {MM * ball_radius:.3g} mm")
    distance = distance_from(sensor, contact)
    height = np.sqrt(np.maximum(ball_radius**2 - distance**2, 0))
    shallow = np.sqrt(ball_radius**2 - reach**2)  # of the ball's centre above the gel, if nothing around is drawn in
    if sensor.membrane == 0 and sensor.gel is None:
        return np.asarray(np.maximum(height - shallow, 0))
    low, high, inside = 0.0, shallow, distance <= reach  # no deeper than its equator
    for _ in range(HALVINGS):  # the deeper the ball, the larger its contact
        middle = (low + high) / 2
        touching = gel_under(np.maximum(height - middle, 0), sensor).contact
        low, high = (middle, high) if touching.sum() > inside.sum() else (low, middle)
    return np.asarray(np.maximum(height - (low + high) / 2, 0))


def distance_from(sensor: Sensor, contact: Circle) -> Array:  # (rows, cols) m
    """Compute the distance of each pixel from a contact's centre."""
    x, y = (np.arange(count) - middle for count, middle in ((sensor.cols, contact.x), (sensor.rows, contact.y)))
    return np.asarray(np.hypot(x[None] * sensor.pitch[1], y[:, None] * sensor.pitch[0]))


def contact_box(sensor: Sensor, contacts: Sequence[Circle]) -> Box:
    """Compute the box around contacts: least x and y, greatest x and y, m, to 10 µm, clipped at the gel's rim."""
    x, y = pixel_centres(sensor)
    at = np.array([(x[0] + circle.x * sensor.pitch[1], y[0] + circle.y * sensor.pitch[0]) for circle in contacts])
    reach = sensor.pitch[1] * np.array([[circle.radius] for circle in contacts])
    rim = np.array([sensor.width, sensor.height]) / 2
    low, high = np.maximum((at - reach).min(axis=0), -rim), np.minimum((at + reach).max(axis=0), rim)
    left, top, right, bottom = np.round([*low, *high], 5).tolist()
    return left, top, right, bottom
