"""Pixels of photographs of a ball in the gel, as rows of the linear equations that a sensor's colours are fitted by."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.touch.ball_contact import RING, Box, Photograph, ball_impression, distance_from
from pipeline.kernels.touch.calibrated_shading import fitted_positions, powers
from pipeline.kernels.touch.pressed_gel import gel_under
from pipeline.kernels.touch.sensor import MM, Sensor

CONTACT_WEIGHT = 3.0
"""Weight of a pixel in the contact, where colours change more, relative to one in the ring around it."""
SAMPLES = 11  # pixels per radius of a contact that are fitted: neighbours hold the same information
RIDGE = 1e-6
"""Share of the mean diagonal of the normal equations, which regularises terms that the photographs do not separate."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Hold n pixels of a photograph."""

    bump: Array  # (rows, cols) m: the gel's indentation in the whole image
    at: tuple[Indices, ...]  # rows and columns of the pixels
    distance: Array  # (n,) from the contact's middle, contact radii: less than 1 in the contact
    features: Array  # (n, k) without unit
    change: Array  # (n, 3) levels that the photograph differs from the untouched one
    contact_weight: float = CONTACT_WEIGHT  # of a pixel in the contact, relative to one around it

    @property
    def inside(self) -> Mask:  # (n,)
        """Find the pixels in the contact."""
        return self.distance < 1

    @cached_property
    def equations(self) -> Array:  # (k, k + 3)
        """Compute the normal equations: their matrix, and beside it their right-hand sides."""
        weighted = np.where(self.inside, self.contact_weight, 1.0)[:, None] * np.hstack([self.features, self.change])
        return np.asarray(weighted.T @ weighted)[: self.features.shape[1]]  # symmetric: numpy computes half of the product

    def error(self, coefficients: Array) -> float:
        """Compute the mean error of colours by coefficients (k, 3): that in the contact plus that in the ring, levels.

        In the ring all radii weigh alike, not all pixels: the gel's depth is the sum of its slopes along a radius.
        """
        size = np.abs(self.change - self.features @ coefficients).mean(axis=1)
        weight = np.where(self.inside, 1.0, 1 / np.maximum(self.distance, 1))
        parts = [part for part in (self.inside, ~self.inside) if part.any()]
        return sum(float(np.average(size[part], weights=weight[part])) for part in parts)

    def with_features(self, features: Array) -> "Sample":
        """Return a sample with other features, (n, any number)."""
        return replace(self, features=features)


def sample_photographs(
    sensor: Sensor,  # gives the geometry and the gel
    photographs: Sequence[Photograph],
    untouched: NDArray[np.uint8],  # (rows, cols, 3)
    *,
    ball_radius: float,  # m
    degrees: tuple[int, int],  # of the polynomials in the normal and in the position
    within: Box,  # from `contact_box`
) -> list[Sample]:  # one per photograph
    """Take the pixels of contacts and of the rings around them.

    Features are in the order of `Calibration.coefficients`, then those of its `depth`.
    """
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
        normal = [(slope_x / size) ** i * (slope_y / size) ** j for i, j in powers(degrees[0])[1:]] + [MM * bump[row, col]]
        place = [x[col] ** i * y[row] ** j for i, j in powers(degrees[1])]
        features = np.stack([slope * spot for slope, spot in product(normal, place)], axis=1)
        change = photograph.image[row, col].astype(np.float64) - untouched[row, col].astype(np.float64)
        samples.append(Sample(bump, (row, col), share, features, change))
    return samples


def solve(equations: Array) -> Array:
    """Solve a sum of `Sample.equations` (k, k + 3) for the coefficients (k, 3), levels."""
    matrix, right = equations[:, :-3], equations[:, -3:]
    ridge = RIDGE * np.trace(matrix) / len(matrix) * np.eye(len(matrix))
    return np.linalg.solve(matrix + ridge, right)


def left_out_error(samples: Sequence[Sample]) -> float:
    """Average the error of each photograph by a fit to all others, levels: contacts plus rings."""
    total = np.sum([sample.equations for sample in samples], axis=0)
    return float(np.mean([sample.error(solve(total - sample.equations)) for sample in samples]))
