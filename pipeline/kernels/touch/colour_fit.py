"""Fit a sensor's membrane and colours to photographs of a ball that is pressed into it.

Valid range: contacts of 8 pixels radius or more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.ball_contact import Photograph, contact_box
from pipeline.kernels.touch.calibrated_shading import MM, powers
from pipeline.kernels.touch.cast_shadow import shade_depth
from pipeline.kernels.touch.colour_samples import Sample, left_out_error, sample_photographs, solve
from pipeline.kernels.touch.optics import Calibration, Levels, Shadow
from pipeline.kernels.touch.sensor import Sensor, pixel_centres

MEMBRANES = (0.0, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
"""Widths of the membrane that are tried, in contact radii."""
POSITION_DEGREES = (0, 1, 2, 3, 4)
"""Degrees of the polynomial in the position that are tried."""
DIRECTIONS, SLOPES = tuple(range(0, 360, 30)), (0.1, 0.2, 0.4)
"""Shadows that are tried: degrees, and height over length."""


@dataclass(frozen=True)
class FitOptions:
    """Degrees of the polynomials in normal and position, None for the one that predicts best, and how many shadows are sought."""

    normal_degree: int = 3
    position_degree: int | None = None
    shadows: int = 3


@dataclass(frozen=True, eq=False)
class ColourFit:
    """Hold what was fitted.

    Attributes
    ----------
    sensor
        The sensor with its membrane.
    calibration
        Its optics; the background is the untouched photograph's mean, a constant.
    position_degree
        Of the polynomial in the position.
    at_end
        Fitted values that lie at the end of the range that was searched, in words.
    """

    sensor: Sensor
    calibration: Calibration
    position_degree: int
    at_end: tuple[str, ...]


def fit_colours(
    sensor: Sensor, photographs: Sequence[Photograph], untouched: NDArray[np.uint8], ball_radius: float, options: FitOptions
) -> ColourFit:
    """Fit membrane, coefficients and shadows.

    Parameters
    ----------
    sensor
        Gives the geometry; its optics are not used.
    photographs
        Two or more.
    untouched
        (rows, cols, 3) uint8, the photograph with nothing in the gel.
    ball_radius
        m.
    options
        Size of the model.

    Returns
    -------
    What was fitted.

    Notes
    -----
    The membrane and the degree in the position are those with which a fit to all photographs but one predicts that one best, on
    average over the photographs. Then all are fitted, and shadows are added, each the one that explains most of what is left.
    """
    radius = float(np.median([photograph.contact.radius for photograph in photographs])) * sensor.pitch[1]
    degrees = POSITION_DEGREES if options.position_degree is None else (options.position_degree,)
    within = contact_box(sensor, [photograph.contact for photograph in photographs])
    terms = len(powers(options.normal_degree)) - 1
    least, chosen = math.inf, None
    for share in MEMBRANES:
        candidate = sensor.model_copy(update={"membrane": share * radius})
        sizes = options.normal_degree, degrees[-1]
        samples = sample_photographs(candidate, photographs, untouched, ball_radius=ball_radius, degrees=sizes, within=within)
        for degree in degrees:
            columns = _columns(terms, degree, degrees[-1])
            if (error := left_out_error(samples, columns)) < least:
                least, chosen = error, (share, candidate, samples, degree, columns)
    assert chosen is not None, "errors are finite"
    share, fitted, samples, degree, columns = chosen
    samples = [Sample(sample.bump, sample.at, sample.inside, sample.features[:, columns], sample.change) for sample in samples]
    samples, shadows = _with_shadows(samples, fitted, options.shadows)
    mean: Levels = tuple(untouched.mean(axis=(0, 1)).tolist())
    calibration = _calibration(samples, shadows, (terms, len(powers(degree))), (mean,), within)
    at_end = []
    if share == MEMBRANES[-1]:
        at_end.append(f"the membrane is as wide as the widest that is tried, {share:g} contact radii: is the ball's radius right?")
    if len(degrees) > 1 and degree == degrees[-1]:
        at_end.append(f"the degree in the position is the highest that is tried, {degree}: --position-degree {degree + 1} may be better")
    return ColourFit(fitted, calibration, degree, tuple(at_end))


def _columns(terms: int, degree: int, highest: int) -> NDArray[np.intp]:
    """List the features of some degree in the position among those of the highest."""
    places, every = len(powers(degree)), len(powers(highest))
    return (every * np.arange(terms)[:, None] + np.arange(places)).ravel()


def _with_shadows(samples: list[Sample], sensor: Sensor, count: int) -> tuple[list[Sample], list[tuple[int, float]]]:
    """Add the features of shadows, each the one that explains most of the remaining error."""
    shadows: list[tuple[int, float]] = []
    shades = {shadow: [_shade(sample, sensor, *shadow) for sample in samples] for shadow in product(DIRECTIONS, SLOPES) if count}
    for _ in range(count):
        coefficients = _solved(samples)
        errors = np.concatenate([sample.change - sample.features @ coefficients for sample in samples])
        gains = {}
        for shadow in shades.keys() - set(shadows):
            shade = np.concatenate(shades[shadow])
            gains[shadow] = float(np.square(shade @ errors).sum() / max(float(shade @ shade), 1e-12))
        shadows.append(max(sorted(gains), key=gains.__getitem__))
        samples = [sample.with_features([shade]) for sample, shade in zip(samples, shades[shadows[-1]], strict=True)]
    return samples, shadows


def _shade(sample: Sample, sensor: Sensor, direction: int, slope: float) -> NDArray[np.float64]:
    return np.asarray(MM * shade_depth(sample.bump, sensor.pitch, direction=np.deg2rad(direction), slope=slope)[sample.at])


def _solved(samples: Sequence[Sample]) -> NDArray[np.float64]:
    return solve(np.sum([sample.equations for sample in samples], axis=0), np.arange(samples[0].features.shape[1]))


def _calibration(
    samples: Sequence[Sample],
    shadows: Sequence[tuple[int, float]],
    shape: tuple[int, int],
    background: tuple[Levels, ...],
    within: tuple[float, float, float, float],
) -> Calibration:
    coefficients = _solved(samples)
    count = shape[0] * shape[1]
    gains = np.round(coefficients[count:], 3).tolist()
    slopes = [np.hypot(sample.features[:, 0], sample.features[:, shape[1]]) for sample in samples]  # the columns of nx and ny alone
    return Calibration(
        coefficients=np.round(coefficients[:count].T.reshape(3, *shape), 3).tolist(),
        background=background,
        shadows=tuple(Shadow(direction=d, slope=s, gain=tuple(gain)) for (d, s), gain in zip(shadows, gains, strict=True)),
        steepest=round(max(float(slope.max()) for slope in slopes), 3),
        deepest=math.ceil(1e6 * max(float(sample.bump.max()) for sample in samples)) / 1e6,
        within=within,
    )


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
