"""The contact of a ball with a gel: its circle in a photograph, the impression behind it, and its pixels as equations.

Valid range: contacts up to the ball's equator.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array, Indices
from pipeline.kernels.touch.calibrated_shading import fitted_positions, polynomial_terms
from pipeline.kernels.touch.depth_maps import gel_under
from pipeline.kernels.touch.sensor import MM, Box, Sensor, pixel_centres

RING = 3.0  # radius of the region around a contact that is fitted and compared, in contact radii
HALVINGS = 14  # of the interval in which a ball's depth is searched: accurate to a ten-thousandth
CONTACT_WEIGHT = 3.0  # of a pixel in the contact, where colours change more, relative to one in the ring around it
SAMPLES = 11  # pixels per radius of a contact that are fitted: neighbours hold the same information
ROUNDING = 1e-9  # share by which a contact at the ball's equator may be larger than it
RIDGE = 1e-6  # share of the mean diagonal of the normal equations, for terms that the photographs do not separate


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
    ball_radius: float,  # m, not less than the contact's
) -> Array:  # (rows, cols) m
    """Compute the impression of a ball from its circle of contact with the sensor's membrane or elastic gel."""
    reach = contact.radius * sensor.pitch[1]
    if reach > ball_radius * (1 + ROUNDING):
        raise ValueError(f"a contact of {MM * reach:.3g} mm radius is too large for a ball of {MM * ball_radius:.3g} mm")
    distance = distance_from(sensor, contact)
    height = np.sqrt(np.maximum(ball_radius**2 - distance**2, 0))
    shallow = math.sqrt(max(ball_radius**2 - reach**2, 0))  # of the ball's centre above the gel, if nothing around is drawn in
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


@dataclass(frozen=True, eq=False)
class Sample:
    """Pixels of a photograph: n of them."""

    bump: Array  # (rows, cols) m: the gel's indentation in the whole image
    at: tuple[Indices, ...]  # rows and columns of the pixels
    distance: Array  # (n,) from the contact's middle, contact radii: less than 1 in the contact
    features: Array  # (n, k) without unit
    change: Array  # (n, 3) levels that the photograph differs from the untouched one
    contact_weight: float = CONTACT_WEIGHT  # of a pixel in the contact, relative to one around it

    @cached_property
    def equations(self) -> Array:  # (k, k + 3)
        """Compute the normal equations: their matrix, and beside it their right-hand sides."""
        weighted = np.where(self.distance < 1, self.contact_weight, 1.0)[:, None] * np.hstack([self.features, self.change])
        return np.asarray(weighted.T @ weighted)[: self.features.shape[1]]  # symmetric: numpy computes half of the product

    def error(self, coefficients: Array) -> float:
        """Compute the mean error by coefficients (k, 3), levels, in the contact plus in the ring, where all radii weigh alike."""
        size = np.abs(self.change - self.features @ coefficients).mean(axis=1)
        inside = self.distance < 1
        weight = np.where(inside, 1.0, 1 / np.maximum(self.distance, 1))
        parts = [part for part in (inside, ~inside) if part.any()]
        return sum(float(np.average(size[part], weights=weight[part])) for part in parts)


def sample_photographs(
    sensor: Sensor,  # gives the geometry and the gel
    photographs: Sequence[Photograph],
    untouched: NDArray[np.uint8],  # (rows, cols, 3)
    *,
    ball_radius: float,  # m
    degrees: tuple[int, int],  # of the polynomials in the normal and in the position
    within: Box,  # from `contact_box`
    contact_weight: float = CONTACT_WEIGHT,
) -> list[Sample]:  # one per photograph, with features in the order of `Calibration.coefficients`, then those of its `depth`
    """Take the pixels of contacts and of the rings around them."""
    stride = max(1, round(float(np.median([photograph.contact.radius for photograph in photographs])) / SAMPLES))
    x, y = fitted_positions(sensor, within)
    samples = []
    for photograph in photographs:
        distance = distance_from(sensor, photograph.contact)[::stride, ::stride] / (photograph.contact.radius * sensor.pitch[1])
        row, col = np.nonzero(distance < RING)
        share = distance[row, col]
        row, col = stride * row, stride * col
        bump = gel_under(ball_impression(sensor, photograph.contact, ball_radius), sensor).indentation
        slope_y, slope_x = (change[row, col] / size for change, size in zip(np.gradient(bump), sensor.pitch, strict=True))
        size = np.sqrt(1 + slope_x**2 + slope_y**2)
        normal = polynomial_terms(slope_x / size, slope_y / size, degrees[0])[1:] + [MM * bump[row, col]]
        position = polynomial_terms(x[col], y[row], degrees[1])
        features = np.stack([slope * spot for slope, spot in product(normal, position)], axis=1)
        change = photograph.image[row, col].astype(np.float64) - untouched[row, col].astype(np.float64)
        samples.append(Sample(bump, (row, col), share, features, change, contact_weight))
    return samples


def solve(equations: Array) -> Array:
    """Solve a sum of `Sample.equations` (k, k + 3) for the coefficients (k, 3), levels."""
    matrix, right = equations[:, :-3], equations[:, -3:]
    ridge = RIDGE * np.trace(matrix) / len(matrix) * np.eye(len(matrix))
    return np.linalg.solve(matrix + ridge, right)


def left_out_errors(samples: Sequence[Sample]) -> Array:  # (samples,)
    """Compute the error of each photograph by a fit to all others, levels: contact plus ring."""
    total = np.sum([sample.equations for sample in samples], axis=0)
    return np.array([sample.error(solve(total - sample.equations)) for sample in samples])
