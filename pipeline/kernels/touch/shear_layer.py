"""How the surface of an elastic layer on a rigid plate moves in its own plane: under tangential traction, and under pressure.

The counterpart of `elastic_layer`, in its units: the layer's plane-strain modulus E / (1 - poisson²) is 1 Pa.
"""

from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.touch.elastic_layer import GAUSS, KNOTS_PER_THICKNESS, NODES, REACH, WAVES


class WaveFactors(NamedTuple):
    """Displacements of a bonded layer under waves of traction, relative to 2 / wave number: what pressure does to a half-space."""

    along: Array  # by a traction along the wave, along it
    across: Array  # by a traction across the wave, across it
    pressed: Array  # by pressure, along the wave, towards the load where positive


def wave_factors(wave: Floats, poisson: float) -> WaveFactors:  # each as wave
    """Solve the bonded layer in plane strain, for a wave number times the thickness; short waves see a half-space.

    With a = wave, k = 3 - 4 poisson and D = 2k cosh 2a + 1 + k² + 4a²: along (2k sinh 2a + 4a) / D, across tanh a / (1 - poisson),
    pressed (2k (k - 1) (cosh 2a - 1) - 8a²) / ((k + 1) D).
    """
    a = np.asarray(wave, np.longdouble)  # extended: the same bits on every processor
    k, small = 3 - 4 * poisson, np.exp(-2 * a)
    below = k * (1 + small**2) + (1 + k**2 + 4 * a**2) * small
    along = (k * (1 - small**2) + 4 * a * small) / below
    across = (1 - small) / (1 + small) / (1 - poisson)
    pressed = (k * (k - 1) * (1 - small) ** 2 - 8 * a**2 * small) / ((k + 1) * below)
    return WaveFactors(*(np.asarray(factor, np.float64) for factor in (along, across, pressed)))


class ShearInfluence(NamedTuple):
    """Displacements in the middles of cells, m, of 1 Pa on the cell i rows and j columns before: along x by a traction along x, and so on.

    `xx` and `yy` are even in both offsets, `xy` (as yx) is odd in both; `xp` and `yp`, of pressure, are odd along x and along y.
    """

    xx: Array  # (rows, cols)
    yy: Array
    xy: Array
    xp: Array
    yp: Array


@lru_cache(maxsize=8)
def shear_influence(
    shape: tuple[int, int],  # rows and columns of the grid
    pitch: tuple[float, float],  # size of a cell along y and x, m
    poisson: float,  # 0 to 0.5
    thickness: float,  # of the layer, m
) -> ShearInfluence:
    """Compute how a uniform traction or pressure on one cell moves the cells of a grid; do not change the result.

    The half-space's part is exact (Cerruti's and Boussinesq's solutions integrated over a rectangle). The layer's corrections are Hankel
    transforms of its factors less a half-space's. Beyond `REACH` nothing moves.
    """
    y, x = (np.arange(count) * size for count, size in zip(shape, pitch, strict=True))
    parts = np.zeros((5, *shape))
    for sign_y, sign_x in product(GAUSS, GAUSS):  # a mean over the cell
        v, u = y[:, None] + sign_y * pitch[0], x[None] + sign_x * pitch[1]
        distance = np.hypot(u, v)
        round_, twofold, outward = _corrections(poisson)(np.minimum(distance / thickness, REACH)).transpose(2, 0, 1)
        cosine, sine = u / distance, v / distance
        even = twofold * (cosine**2 - sine**2)
        parts += [round_ + even, round_ - even, 2 * twofold * cosine * sine, outward * cosine, outward * sine]
    parts *= pitch[0] * pitch[1] / (4 * np.pi * thickness)
    parts += _half_space(shape, pitch, poisson)
    parts[:, np.hypot(y[:, None], x[None]) >= REACH * thickness] = 0
    parts.flags.writeable = False
    return ShearInfluence(*parts)


@lru_cache(maxsize=8)
def _corrections(poisson: float) -> "scipy.interpolate.CubicSpline":
    """Integrate a layer's factors less a half-space's, by distance in thicknesses: for all directions, twofold, and of pressure."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    wave, weights = (nodes + 1) * WAVES / 2, weights * WAVES / 2
    factors = wave_factors(wave, poisson)
    along, across = factors.along - 1, factors.across - 1 / (1 - poisson)
    pressed = factors.pressed - (1 - 2 * poisson) / (2 * (1 - poisson))
    distance = np.linspace(0, REACH, int(REACH * KNOTS_PER_THICKNESS) + 1)
    phase = np.maximum(distance[:, None] * wave, 1e-9)
    j0, j1 = scipy.special.j0(phase), scipy.special.j1(phase)
    j2 = 2 * j1 / phase - j0
    integrals = [((along + across) / 2, j0), ((across - along) / 2, j2), (-pressed, j1)]
    by_distance = [(bessel * (weights * factor)).sum(axis=1) for factor, bessel in integrals]
    return scipy.interpolate.CubicSpline(distance, np.stack(by_distance, axis=1))


def _half_space(shape: tuple[int, int], pitch: tuple[float, float], poisson: float) -> Array:  # (5, rows, cols)
    """Integrate a half-space's displacements over a cell: differences of indefinite integrals between its corners."""
    y, x = (np.arange(count, dtype=np.longdouble) * size for count, size in zip(shape, pitch, strict=True))
    total = np.zeros((5, *shape), np.longdouble)
    for sign_y, sign_x in product((1, -1), (1, -1)):
        v, u = y[:, None] + sign_y * pitch[0] / 2, x[None] + sign_x * pitch[1] / 2
        radius = np.sqrt(u**2 + v**2)
        by_x, by_y = v * np.arcsinh(u / np.abs(v)), u * np.arcsinh(v / np.abs(u))
        inward = (2 * poisson - 1) / 2
        total += sign_y * sign_x * np.stack(
            [
                by_x + (1 - poisson) * by_y,
                by_y + (1 - poisson) * by_x,
                -poisson * radius,
                inward * (v * np.log(radius) + u * np.arctan(v / u)),
                inward * (u * np.log(radius) + v * np.arctan(u / v)),
            ]
        )  # fmt: skip
    return np.asarray(total / (np.pi * (1 - poisson)), np.float64)  # 2 pi times the shear modulus
