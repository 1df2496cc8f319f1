"""Fit a sensor's colours to photographs of a ball that is pressed into it.

Valid range: contacts of 8 pixels radius or more; balls larger than their contacts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.calibrated_shading import MM, deformed, fitted_positions, powers
from pipeline.kernels.touch.cast_shadow import shade_depth
from pipeline.kernels.touch.optics import Calibration, Levels, Shadow
from pipeline.kernels.touch.sensor import Sensor, pixel_centres

RING = 3.0
"""Contact radii around a contact that are fitted."""
CONTACT_WEIGHT = 3.0
"""Weight of a pixel in the contact, where colours change more, relative to one in the ring around it."""
STRIDE = 3
"""Every third row and column is fitted: neighbours hold the same information."""
RIDGE = 1e-6
"""Share of the mean diagonal of the normal equations, which regularises terms that the photographs do not separate."""
MEMBRANES = (0.0, 0.15, 0.25, 0.35, 0.5, 0.7)
"""Widths of the membrane that are tried, in contact radii."""
DIRECTIONS, SLOPES = tuple(range(0, 360, 30)), (0.1, 0.2, 0.4)
"""Shadows that are tried: degrees, and height over length."""
HALVINGS = 14
"""Of the interval in which a ball's depth is sought: to a ten-thousandth."""


Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Circle:
    """A contact in an image: centre and radius, pixels; the centre of pixel (0, 0) is (0, 0)."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph of a ball in the gel: (rows, cols, 3) uint8, and its contact."""

    name: str
    image: NDArray[np.uint8]
    contact: Circle


@dataclass(frozen=True)
class FitOptions:
    """Degrees of the polynomials in normal and position, and how many shadows are sought."""

    normal_degree: int = 3
    position_degree: int = 2
    shadows: int = 3


def ball_impression(sensor: Sensor, contact: Circle, ball_radius: float) -> NDArray[np.float64]:
    """Compute the impression of a ball whose contact with the gel, as the sensor's membrane leaves it, is a given circle.

    Parameters
    ----------
    sensor
        Gives pixels and membrane.
    contact
        The circle; its radius is one along x where pixels are not square.
    ball_radius
        m, more than the contact's.

    Returns
    -------
    (rows, cols) float64, m.

    Raises
    ------
    ValueError
        The contact is as large as the ball.
    """
    reach = contact.radius * sensor.pitch[1]
    if reach >= ball_radius:
        raise ValueError(f"a contact of {MM * reach:.3g} mm radius is too large for a ball of {MM * ball_radius:.3g} mm")
    distance = distance_from(sensor, contact)
    height = np.sqrt(np.maximum(ball_radius**2 - distance**2, 0))
    shallow = np.sqrt(ball_radius**2 - reach**2)  # of the ball's centre above the gel, if nothing around is drawn in
    if sensor.membrane == 0:
        return np.asarray(np.maximum(height - shallow, 0))
    low, high, inside = -ball_radius, shallow, distance <= reach
    for _ in range(HALVINGS):  # the deeper the ball, the larger its contact
        middle = (low + high) / 2
        pressed = np.maximum(height - middle, 0)
        touching = (pressed > 0) & (deformed(pressed, sensor) <= pressed)
        low, high = (middle, high) if touching.sum() > inside.sum() else (low, middle)
    return np.asarray(np.maximum(height - (low + high) / 2, 0))


def distance_from(sensor: Sensor, contact: Circle) -> NDArray[np.float64]:
    """Compute the distance of every pixel from a contact's centre, (rows, cols) float64, m."""
    x, y = (np.arange(count) - middle for count, middle in ((sensor.cols, contact.x), (sensor.rows, contact.y)))
    return np.asarray(np.hypot(x[None] * sensor.pitch[1], y[:, None] * sensor.pitch[0]))


def fit_calibration(
    sensor: Sensor, photographs: Sequence[Photograph], untouched: NDArray[np.uint8], ball_radius: float, options: FitOptions
) -> tuple[Sensor, Calibration]:
    """Fit membrane, coefficients and shadows.

    Parameters
    ----------
    sensor
        Gives the geometry; its optics are not used.
    photographs
        One or more.
    untouched
        (rows, cols, 3) uint8, the photograph with nothing in the gel.
    ball_radius
        m.
    options
        Size of the model.

    Returns
    -------
    The sensor with its membrane, and the optics; the background is the photograph's mean, a constant.
    """
    radius = float(np.median([photograph.contact.radius for photograph in photographs])) * sensor.pitch[1]
    candidates = [sensor.model_copy(update={"membrane": share * radius}) for share in MEMBRANES]
    fits = [_Fit(candidate, photographs, untouched, ball_radius, options) for candidate in candidates]
    best = min(fits, key=lambda fit: fit.residual)
    for _ in range(options.shadows):
        best = best.with_shadow()
    mean: Levels = tuple(untouched.mean(axis=(0, 1)).tolist())
    return best.sensor, best.calibration((mean,))


class _Fit:
    """The linear fit at one membrane; `residual` is the mean error of contacts plus that of rings, levels."""

    def __init__(
        self, sensor: Sensor, photographs: Sequence[Photograph], untouched: NDArray[np.uint8], ball_radius: float, options: FitOptions
    ) -> None:
        self.sensor, self.options = sensor, options
        self.shadows: tuple[tuple[int, float], ...] = ()
        contacts = [photograph.contact for photograph in photographs]
        self.bumps = [deformed(ball_impression(sensor, circle, ball_radius), sensor) for circle in contacts]
        distances = [distance_from(sensor, circle) / (circle.radius * sensor.pitch[1]) for circle in contacts]
        grid = np.zeros(sensor.shape, bool)
        grid[::STRIDE, ::STRIDE] = True
        self.where = [np.nonzero((distance < RING) & grid) for distance in distances]
        self.inside = np.concatenate([distance[at] < 1 for distance, at in zip(distances, self.where, strict=True)])
        self.within = contact_box(sensor, contacts)
        rows = [shading_features(bump, sensor, options, self.within)[at] for bump, at in zip(self.bumps, self.where, strict=True)]
        self.features = np.concatenate(rows)
        images = [photograph.image for photograph in photographs]
        self.change = np.concatenate([image[at].astype(float) - untouched[at] for image, at in zip(images, self.where, strict=True)])
        self._solve()

    def _solve(self) -> None:
        weight = np.where(self.inside, CONTACT_WEIGHT, 1.0)[:, None]
        rows = weight * self.features
        normal = rows.T @ rows
        ridge = RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal))
        self.coefficients = np.linalg.solve(normal + ridge, rows.T @ (weight * self.change))  # (features, 3)
        self.error = self.change - self.features @ self.coefficients
        size = np.abs(self.error).mean(axis=1)
        self.residual = float(size[self.inside].mean() + size[~self.inside].mean())

    def with_shadow(self) -> _Fit:
        """Add the shadow that explains most of the remaining error."""

        def gain(candidate: tuple[int, float]) -> float:
            shade = self._shade(*candidate)
            return float(np.square(shade @ self.error).sum() / max(float(shade @ shade), 1e-12))

        chosen = max((shadow for shadow in product(DIRECTIONS, SLOPES) if shadow not in self.shadows), key=gain)
        self.shadows = (*self.shadows, chosen)
        self.features = np.column_stack([self.features, self._shade(*chosen)])
        self._solve()
        return self

    def _shade(self, direction: int, slope: float) -> NDArray[np.float64]:
        parts = zip(self.bumps, self.where, strict=True)
        return MM * np.concatenate([shade_depth(b, self.sensor.pitch, direction=np.deg2rad(direction), slope=slope)[at] for b, at in parts])

    def calibration(self, background: tuple[Levels, ...]) -> Calibration:
        """Return the fitted optics."""
        count = len(self.coefficients) - len(self.shadows)
        terms = len(powers(self.options.normal_degree)) - 1
        shading = np.round(self.coefficients[:count].T.reshape(3, terms, -1), 3)
        gains = np.round(self.coefficients[count:], 3).tolist()
        shadows = [Shadow(direction=d, slope=s, gain=tuple(gain)) for (d, s), gain in zip(self.shadows, gains, strict=True)]
        places = len(powers(self.options.position_degree))
        steepest = float(np.hypot(self.features[:, 0], self.features[:, places]).max())  # the columns of nx and ny alone
        deepest = max(float(bump.max()) for bump in self.bumps)
        return Calibration(
            coefficients=shading.tolist(),
            background=background,
            shadows=tuple(shadows),
            steepest=round(steepest, 3),
            deepest=math.ceil(1e6 * deepest) / 1e6,
            within=self.within,
        )


def contact_box(sensor: Sensor, contacts: Sequence[Circle]) -> Box:
    """Compute the part of the gel in which contacts lie: least x and y, greatest x and y, m, to 10 µm."""
    x, y = pixel_centres(sensor)
    at = np.array([(x[0] + circle.x * sensor.pitch[1], y[0] + circle.y * sensor.pitch[0]) for circle in contacts])
    reach = sensor.pitch[1] * np.array([[circle.radius] for circle in contacts])
    left, top, right, bottom = np.round([*(at - reach).min(axis=0), *(at + reach).max(axis=0)], 5).tolist()
    return left, top, right, bottom


def shading_features(bump: NDArray[np.float64], sensor: Sensor, options: FitOptions, within: Box) -> NDArray[np.float64]:
    """Compute the features of every pixel, in the order of `Calibration.coefficients`.

    Parameters
    ----------
    bump
        (rows, cols), height of the gel's surface above its rest, m.
    sensor
        Gives the pixels.
    options
        Gives the degrees of the polynomials.
    within
        From `contact_box`.

    Returns
    -------
    (rows, cols, terms of the normal × terms of the position) float64.
    """
    slope_y, slope_x = (change / size for change, size in zip(np.gradient(bump), sensor.pitch, strict=True))
    size = np.sqrt(1 + slope_x**2 + slope_y**2)
    a, b = slope_x / size, slope_y / size
    x, y = fitted_positions(sensor, within)
    normal = [a**i * b**j for i, j in powers(options.normal_degree)[1:]]
    place = [x[None] ** i * y[:, None] ** j for i, j in powers(options.position_degree)]
    return np.stack([a * b for a, b in product(normal, place)], axis=-1)


def fit_background(image: NDArray[np.uint8], sensor: Sensor, degree: int) -> tuple[Levels, ...]:
    """Fit a polynomial of the position to an untouched image.

    Parameters
    ----------
    image
        (rows, cols, 3).
    sensor
        Gives the pixels.
    degree
        Of the polynomial.

    Returns
    -------
    Levels of red, green and blue by term.
    """
    x, y = (centres / sensor.width for centres in pixel_centres(sensor))
    terms = np.stack([np.broadcast_to(x[None] ** i * y[:, None] ** j, sensor.shape).ravel() for i, j in powers(degree)], axis=1)
    levels = np.linalg.lstsq(terms, image.reshape(-1, 3).astype(float), rcond=None)[0]
    red, green, blue = np.round(levels.T, 3).tolist()
    return tuple(zip(red, green, blue, strict=True))
