"""Fit a sensor's gel and colours to photographs of a ball that is pressed into it, and say which photographs are missing.

Valid range: contacts of 8 pixels radius or more.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.contrib.calibration.ball_contact import (
    CONTACT_WEIGHT,
    Circle,
    Photograph,
    Sample,
    contact_box,
    left_out_errors,
    sample_photographs,
    solve,
)
from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.calibrated_shading import polynomial_terms, powers, shade_depth, slope_degrees
from pipeline.kernels.touch.sensor import MM, POSITION_TERMS, Box, Calibration, Gel, Levels, Sensor, Shadow, pixel_centres

MEMBRANES = (0.0, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)  # widths of the membrane that are tried, contact radii
THICKNESSES = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)  # of an elastic gel, contact radii, up to the sensor's w
AGREE = 1.5  # largest ratio of the thicknesses that the smaller and the larger contacts ask for: of neighbours in `THICKNESSES`
MODULUS = 2e5  # Pa, of an elastic gel whose forces were not measured: its shape does not depend on it
POSITION_DEGREES = (0, 1, 2, 3, 4, 5)  # degrees of the polynomial in the position that are tried
GAIN = 0.02  # share of the least error by which a later choice must improve to be preferred
USUAL_DEGREE = 2  # with which the gel is chosen if no degree is given: the best gel hardly depends on it
DIRECTIONS, SLOPES = tuple(range(0, 360, 30)), (0.1, 0.2, 0.4)  # shadows that are tried: degrees, height over length
STEEP = 45.0  # degrees of slope of a pressed edge: steeper ones are photographed with a ball that is pressed in deeply
ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "middle", "right")  # thirds of the gel in its image


@dataclass(frozen=True)
class ColourFitOptions:
    """Options of a fit."""

    normal_degree: int = 3  # of the polynomial in the normal
    position_degree: int | None = None  # of the one in the position; None for the one that predicts best
    shadows: int = 3  # how many to fit
    elastic: bool | None = None  # an elastic layer of fitted thickness, or a membrane; None for what predicts best
    poisson: float = 0.48  # Poisson's ratio of an elastic gel
    contact_weight: float = CONTACT_WEIGHT  # of a pixel in the contact (slopes of the ball) over one around it (of the gel)


FIT_FOR_DEPTH = ColourFitOptions(elastic=True, poisson=0.3, contact_weight=30.0)
"""Options for a sensor whose photographs a network reads. The colours are those of contacts, where the ball's slopes are known; the elastic
gel is the one that best predicts the rings around them. A membrane leaves a step at walls, which no network can read."""


@dataclass(frozen=True, eq=False)
class ColourFit:
    """The result of a fit."""

    sensor: Sensor  # with its membrane or elastic gel
    calibration: Calibration  # its optics; the background is the untouched photograph's mean, a constant
    position_degree: int
    doubts: tuple[str, ...]  # a sentence for each fitted value that the photographs do not determine, or at the end of the searched range


@dataclass(frozen=True)
class _GelShape:
    """An elastic gel of a thickness, or a membrane of a width, in contact radii."""

    elastic: bool
    size: float
    poisson: float = 0.48

    def of(self, sensor: Sensor, radius: float) -> Sensor:
        """Give a sensor this gel, for contacts of some radius, m."""
        gel = Gel(modulus=MODULUS, poisson=self.poisson, thickness=round(self.size * radius, 6)) if self.elastic else None
        return sensor.model_copy(update={"membrane": 0.0 if self.elastic else round(self.size * radius, 6), "gel": gel})


def fit_colours(
    sensor: Sensor,  # gives the geometry; its optics are not used
    photographs: Sequence[Photograph],  # two or more
    untouched: NDArray[np.uint8],  # (rows, cols, 3) the photograph with nothing in the gel
    ball_radius: float,  # m
    options: ColourFitOptions,
) -> ColourFit:
    """Fit the gel, coefficients and shadows.

    The gel, and then the degree in the position, are those with which a fit to all photographs but one predicts that one best, on average;
    a wider membrane, a thicker gel or a higher degree is taken only if it gains more than `GAIN`. An elastic gel has the sensor's thickness
    w if smaller and larger contacts ask for different ones. Then all photographs are fitted, and shadows are added, each the one that
    explains most of what is left.
    """
    radius = float(np.median([photograph.contact.radius for photograph in photographs])) * sensor.pitch[1]
    within = contact_box(sensor, [photograph.contact for photograph in photographs])

    sample = partial(sample_photographs, photographs=photographs, untouched=untouched, ball_radius=ball_radius, within=within)

    def sampled(candidate: Sensor, degree: int) -> list[Sample]:
        return sample(candidate, degrees=(options.normal_degree, degree), contact_weight=options.contact_weight)

    position_degree = options.position_degree
    usual = USUAL_DEGREE if position_degree is None else position_degree
    gels = [_GelShape(False, width) for width in MEMBRANES if not options.elastic]
    assumed = sensor.w / radius
    thicknesses = [] if options.elastic is False else [*(size for size in THICKNESSES if size < assumed), assumed]
    gels += [_GelShape(True, thickness, options.poisson) for thickness in thicknesses]
    errors = np.array([left_out_errors(sampled(gel.of(sensor, radius), usual)) for gel in gels])  # (gels, photographs)
    gel, doubts = _choose_gel(gels, errors, np.array([photograph.contact.radius for photograph in photographs]), radius)
    fitted = gel.of(sensor, radius)
    samples = sampled(fitted, POSITION_DEGREES[-1] if position_degree is None else position_degree)
    terms = len(powers(options.normal_degree))  # without a constant, and with the depth
    if position_degree is None:
        by_degree = [_up_to_degree(samples, degree, terms) for degree in POSITION_DEGREES]
        chosen = _simplest_good([left_out_errors(of_degree).mean() for of_degree in by_degree])
        position_degree, samples = POSITION_DEGREES[chosen], by_degree[chosen]
    samples, shadows = _with_shadows(samples, fitted, options.shadows)
    mean: Levels = tuple(untouched.mean(axis=(0, 1)).tolist())
    if options.position_degree is None and position_degree == POSITION_DEGREES[-1]:
        doubts.append(f"the degree in the position is the highest that is tried: --position-degree {position_degree + 1} may be better")
    calibration = _calibration(samples, shadows, (terms, len(powers(position_degree))), (mean,), within)
    return ColourFit(fitted, calibration, position_degree, tuple(doubts))


def _simplest_good(errors: Sequence[float]) -> int:
    """Find the first choice, the simplest, whose error is at most `GAIN` above the least."""
    return next(number for number, error in enumerate(errors) if error <= (1 + GAIN) * min(errors))


def _choose_gel(
    gels: Sequence[_GelShape],  # of which the last has the assumed thickness, if one is elastic
    errors: Array,  # (gels, photographs)
    sizes: Array,  # (photographs,) radii of the contacts
    radius: float,  # that gels are measured in, m
) -> tuple[_GelShape, list[str]]:
    """Choose the gel that predicts best, or, if contacts disagree on its thickness, the assumed one; and describe doubts."""
    best, ask = gels[_simplest_good(errors.mean(axis=1).tolist())], "is the ball's radius right?"
    if not best.elastic:
        widest = best.size == MEMBRANES[-1]
        return best, [f"the membrane is as wide as the widest that is tried, {best.size:g} contact radii: {ask}"] if widest else []
    of_halves = np.array_split(np.argsort(sizes, kind="stable"), 2)
    small, large = (gels[_simplest_good(errors[:, half].mean(axis=1).tolist())].size for half in of_halves)
    held = f"the thickness of the gel, {MM * radius * gels[-1].size:.3g} mm, is taken, which --thickness states"
    if best is gels[-1]:
        return best, [f"photographs show no elastic layer that is thinner than the gel: {held}"]
    if max(small, large) > AGREE * min(small, large):
        asked = " and ".join(f"{MM * radius * size:.2g} mm" for size in (small, large))
        return gels[-1], [f"photographs do not determine the elastic layer (smaller and larger contacts ask for {asked}): {held}"]
    thinnest = best.size == THICKNESSES[0]
    return best, [f"the elastic layer is as thin as the thinnest that is tried, {best.size:g} contact radii: {ask}"] if thinnest else []


def _up_to_degree(samples: Sequence[Sample], degree: int, terms: int) -> list[Sample]:
    """Keep the features up to some degree in the position, of samples with `terms` of normal and depth."""
    stored_terms, kept_terms = samples[0].features.shape[1] // terms, len(powers(degree))
    columns = (stored_terms * np.arange(terms)[:, None] + np.arange(kept_terms)).ravel()
    return [replace(sample, features=sample.features[:, columns]) for sample in samples]


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
        pairs = zip(samples, shades[shadows[-1]], strict=True)
        samples = [replace(sample, features=np.column_stack([sample.features, shade])) for sample, shade in pairs]
    return samples, shadows


def _shade(sample: Sample, sensor: Sensor, direction: int, slope: float) -> Array:
    return np.asarray(MM * shade_depth(sample.bump, sensor.pitch, direction=np.deg2rad(direction), slope=slope)[sample.at])


def _solved(samples: Sequence[Sample]) -> Array:
    return solve(np.sum([sample.equations for sample in samples], axis=0))


def _calibration(
    samples: Sequence[Sample],
    shadows: Sequence[tuple[int, float]],
    shape: tuple[int, int],
    background: tuple[Levels, ...],
    within: Box,
) -> Calibration:
    coefficients = _solved(samples)
    count = shape[0] * shape[1]
    fitted = np.round(coefficients[:count].T.reshape(3, *shape), 3)
    gains = np.round(coefficients[count:], 3).tolist()
    slopes = [np.hypot(sample.features[:, 0], sample.features[:, shape[1]]) for sample in samples]  # the columns of nx and ny alone
    return Calibration(
        coefficients=fitted[:, :-1].tolist(),
        depth=fitted[:, -1].tolist(),
        background=background,
        shadows=tuple(Shadow(direction=d, slope=s, gain=tuple(gain)) for (d, s), gain in zip(shadows, gains, strict=True)),
        steepest=round(max(float(slope.max()) for slope in slopes), 3),
        deepest=math.ceil(1e6 * max(float(sample.bump.max()) for sample in samples)) / 1e6,
        within=within,
    )


def fit_background(image: NDArray[np.uint8], sensor: Sensor, degree: int) -> tuple[Levels, ...]:  # by term
    """Fit a polynomial of the position to an untouched image (rows, cols, 3)."""
    x, y = (centres / sensor.width for centres in pixel_centres(sensor))
    terms = np.stack([term.ravel() for term in polynomial_terms(x[None], y[:, None], degree)], axis=1)
    levels = np.linalg.lstsq(terms, image.reshape(-1, 3).astype(float), rcond=None)[0]
    red, green, blue = np.round(levels.T, 3).tolist()
    return tuple(zip(red, green, blue, strict=True))


def missing_photographs(sensor: Sensor, calibration: Calibration, contacts: Sequence[Circle]) -> list[str]:
    """List the photographs that a calibration lacks, as lines of text, given the contacts that it was fitted to.

    They name the parts of the gel without the middle of a contact, unless colours do not depend on the position, and missing slopes.
    """
    thirds = {(math.floor(3 * (circle.y + 0.5) / sensor.rows), math.floor(3 * (circle.x + 0.5) / sensor.cols)) for circle in contacts}
    empty = [cell for cell in product(range(3), repeat=2) if cell not in thirds]
    names = ["middle" if cell == (1, 1) else f"{ROWS[cell[0]]} {COLUMNS[cell[1]]}" for cell in empty]
    lines = []
    if empty and POSITION_TERMS[len(calibration.coefficients[0][0])] > 0:
        lines.append(f"no contact in the {', '.join(names)} of the gel: press there")
    if (steepest := slope_degrees(calibration)) < STEEP:
        lines.append(f"no slope steeper than {steepest:.0f} degrees: press deeper, or use a smaller ball")
    return lines
