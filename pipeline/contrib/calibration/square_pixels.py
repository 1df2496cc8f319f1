"""Measure the height of a pixel over its width in photographs of a ball, by a fit to all of them together.

In a contact the gel has the normals of the ball, however large the contact is. So one polynomial of normal, depth and position gives the
colours of all contacts, and each ends where colours turn back, as the gel's slope falls around it. A single photograph does not show that:
colours may be strongest inside a deep contact, and lamps make one side of its rim pale. The ratio of rims holds for any gel; their size
does not (circles are 5 % too small around an elastic layer, 10 % around a membrane), so it is not used.

Valid range: four photographs or more, contacts of 8 pixels radius or more.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma, gammaincc

from pipeline.contrib.calibration.ball_contact import RIDGE, Photograph
from pipeline.contrib.calibration.find_contact import smooth_change
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.calibrated_shading import polynomial_terms

NORMAL_DEGREE, POSITION_DEGREE = 3, 2  # of the polynomial
FALL = 0.75
"""The gel's slope falls by exp(-(d / length)^FALL) at a distance d from the contact: between a sheet's, 1, and an elastic layer's."""
SAMPLES = 7  # pixels per radius of a contact that are fitted
AROUND, FURTHEST = 2.0, 0.6  # the fitted region: radii of the contact, and radii of the ball beyond it at most
OUTLIER = 6.0  # levels beyond which an error counts linearly: shadows
FIXED, TINY = 1e9, 1e-12  # damping that changes no shape; added to diagonals
STEPS, SETTLED = 30, 1e-3  # of the fit; share of the error by which a last step improves it
DAMPING, GENTLER, HARDER = 0.1, 0.3, 4.0  # of Levenberg and Marquardt: at first, its factor after a step that helps, and after another
LEAST, MOST = (0.05, 0.02), (0.985, 1.0)  # radius of a contact and length of the fall, radii of the ball
ASIDE = 0.1  # largest shift of a middle, radii of the ball
CHANGE = 1e-4  # of a shape for its derivatives
SQUARE = 0.04  # largest logarithm of the measured height over width of square pixels: 0.013 in simulated photographs
SHOWN = 0.06  # share of the error that pixels a tenth too high must add for a judgement: 0.03 where rims are not seen, else 0.1 or more


def check_square(photographs: Sequence[Photograph], untouched: NDArray[np.uint8], ball: float) -> list[str]:
    """Raise an `InvalidInput` if pixels are not square; if photographs do not show it, return a sentence that says so."""
    fit = _JointFit(photographs, untouched, ball)
    error, curvature = fit.settle()
    if curvature * math.log(1.1) ** 2 < SHOWN * error:
        return ["photographs hardly show where contacts end, nor whether pixels are square: press less deeply, or add --mm-per-row"]
    if abs(fit.stretch) <= SQUARE:
        return []
    shape = f"{100 * math.expm1(abs(fit.stretch)):.0f} % {'wider than high' if fit.stretch > 0 else 'higher than wide'}"
    raise InvalidInput(
        f"contacts are {shape}, in pixels (by a fit to all {len(photographs)}): pixels are not square; add --mm-per-row: by this "
        f"measurement {math.exp(fit.stretch):.3f} times --mm-per-pixel, which is along a row"
    )


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Pixels around a contact: n of them."""

    x: Array  # (n,) radii of the ball
    y: Array  # (n,)
    position: Array  # (n, terms) terms of the position in the image
    change: Array  # (n, 3) levels

    def features(self, shape: Array, stretch: float) -> Array:  # (n, k)
        """Compute the terms of normal and depth at each position, for a contact: x, y, radius, length of the fall, radii of the ball."""
        x, y, radius, length = shape
        right, down = self.x - x, math.exp(stretch) * (self.y - y)
        distance = np.hypot(right, down) + 1e-9
        rise = math.sqrt(1 - radius**2)
        steepest, fallen = radius / rise, (np.maximum(distance - radius, 0) / length) ** FALL
        slope = steepest * np.exp(-fallen)
        lean = np.where(distance < radius, distance, slope / np.sqrt(1 + slope**2)) / distance
        skirt = steepest * length / FALL * gamma(1 / FALL) * gammaincc(1 / FALL, fallen)  # the integral of the slope from there on
        depth = np.where(distance < radius, np.sqrt(np.maximum(1 - distance**2, 0)) - rise, 0) + skirt
        normal = np.stack([*polynomial_terms(lean * right, lean * down, NORMAL_DEGREE)[1:], depth], axis=1)
        return np.asarray((normal[:, :, None] * self.position[:, None]).reshape(len(normal), -1))


class _JointFit:
    """Colours (k, 3) of all photographs, levels; a shape per contact; `stretch`, the logarithm of a pixel's height over its width."""

    def __init__(self, photographs: Sequence[Photograph], untouched: NDArray[np.uint8], ball: float) -> None:
        self.pixels: list[_Pixels] = []
        starts: list[list[float]] = []
        for photograph in photographs:
            contact = photograph.contact
            stride, reach = max(1, round(contact.radius / SAMPLES)), min(AROUND * contact.radius, contact.radius + FURTHEST * ball)
            change = smooth_change(photograph.image, untouched)[::stride, ::stride]
            row, col = np.meshgrid(*(stride * np.arange(count) for count in change.shape[:2]), indexing="ij")
            near = np.hypot(col - contact.x, row - contact.y) < reach
            row, col, size = row[near], col[near], max(untouched.shape) / 2
            position = polynomial_terms(col / size - 1, row / size - 1, POSITION_DEGREE)
            self.pixels.append(_Pixels(col / ball, row / ball, np.stack(position, axis=1), change[near]))
            starts.append([contact.x / ball, contact.y / ball, contact.radius / ball, 0.2 * contact.radius / ball])
        self.shapes = np.array(starts)  # (photographs, 4)
        self.low, self.high = self.shapes - ASIDE, self.shapes + ASIDE
        self.low[:, 2:], self.high[:, 2:] = LEAST, MOST
        self.shapes = np.clip(self.shapes, self.low, self.high)
        self.stretch = 0.0
        self.colours = np.zeros((self.pixels[0].features(self.shapes[0], self.stretch).shape[1], 3))

    def settle(self) -> tuple[float, float]:
        """Fit everything by damped Gauss-Newton steps; return the error and its curvature in `stretch`."""
        for _ in range(2):  # the second time with weights
            self.colours = self._step(FIXED)[0]
        error, damping = self._error(self.colours, self.shapes, self.stretch), DAMPING
        for _ in range(STEPS):
            colours, shapes, stretch, _ = self._step(damping)
            reached = self._error(colours, shapes, stretch)
            if reached > error:
                damping *= HARDER
                continue
            gain, error, damping = 1 - reached / error, reached, GENTLER * damping
            self.colours, self.shapes, self.stretch = colours, shapes, stretch
            if gain < SETTLED:
                break
        return error, self._step(0.0)[3]

    def _error(self, colours: Array, shapes: Array, stretch: float) -> float:
        """Compute the mean squared error, in units of `OUTLIER`; beyond it errors count linearly."""
        pairs = zip(self.pixels, shapes, strict=True)
        squares = [np.square(pixels.change - pixels.features(shape, stretch) @ colours).sum(axis=1) for pixels, shape in pairs]
        return float(np.mean([2 * (np.sqrt(1 + square / OUTLIER**2) - 1).mean() for square in squares]))

    def _step(self, damping: float) -> tuple[Array, Array, float, float]:
        """Solve the weighted normal equations, shapes eliminated: colours, shapes, `stretch`; and the curvature in it."""
        matrix, right = np.zeros((self.colours.size + 1,) * 2), np.zeros(self.colours.size + 1)
        solved: list[Array] = []
        for pixels, shape in zip(self.pixels, self.shapes, strict=True):
            features = pixels.features(shape, self.stretch)
            weight = 1 / np.sqrt(1 + np.square(pixels.change - features @ self.colours).sum(axis=1) / OUTLIER**2)
            weight /= weight.size * len(self.pixels) * OUTLIER**2
            moved = [pixels.features(shape + step[:4], self.stretch + step[4]) for step in CHANGE * np.eye(5)]
            slopes = np.stack([(other - features) @ self.colours / CHANGE for other in moved])  # (5, n, 3)
            cross = np.einsum("nk,jnc->jkc", weight[:, None] * features, slopes).reshape(5, -1)
            inner, pull = np.einsum("inc,n,jnc->ij", slopes, weight, slopes), np.einsum("jnc,n,nc->j", slopes, weight, pixels.change)
            inner += np.diag(damping * inner.diagonal() + TINY)
            common = np.column_stack([cross[:4], inner[:4, 4]])  # (4, all but the shapes)
            solved.append(np.linalg.solve(inner[:4, :4], np.column_stack([common, pull[:4]])))
            matrix[:-1, :-1] += np.kron(features.T @ (weight[:, None] * features), np.eye(3))
            matrix[-1] += np.append(cross[4], inner[4, 4])
            matrix[:-1, -1] += cross[4]
            right += np.append((features.T @ (weight[:, None] * pixels.change)).ravel(), pull[4]) - common.T @ solved[-1][:, -1]
            matrix -= common.T @ solved[-1][:, :-1]
        matrix[:-1, :-1] += RIDGE * np.trace(matrix[:-1, :-1]) / self.colours.size * np.eye(self.colours.size)
        inverse = np.linalg.inv(matrix)
        unknown = inverse @ right
        shapes = self.shapes + [own[:, -1] - own[:, :-1] @ unknown for own in solved]
        return unknown[:-1].reshape(-1, 3), np.clip(shapes, self.low, self.high), self.stretch + unknown[-1], 1 / inverse[-1, -1]
