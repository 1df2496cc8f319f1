"""How the surface of an elastic layer on a rigid plate yields to pressure: of one cell of a grid, and of waves.

A layer much thicker than the grid is a half-space.
"""

from functools import lru_cache
from itertools import product

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Floats

REACH = 30.0  # thicknesses from a load at which a layer no longer moves: less than 1e-9 of a half-space's displacement
KNOTS_PER_THICKNESS = 100
WAVES, NODES = 16.0, 400  # wave number times thickness from which a layer is a half-space to 1e-13; nodes of the quadrature
GAUSS = (-0.5 / 3**0.5, 0.5 / 3**0.5)  # nodes of a quadrature over a cell, in cells


@lru_cache(maxsize=8)
def influence(
    shape: tuple[int, int],  # rows and columns of the grid
    pitch: tuple[float, float],  # size of a cell along y and x, m
    poisson: float,  # 0 to 0.5
    thickness: float,  # of the layer, m
) -> Array:  # (rows, cols) m, read-only
    """Compute the displacements that a uniform pressure on one cell causes in the cells of a grid.

    [i, j] is the displacement into the layer in the middle of the cell i rows and j columns away, of a pressure of 1 Pa where the layer's
    plane-strain modulus E / (1 - poisson²) is 1 Pa. The base is bonded to a rigid plate, the surface is free of friction.

    The half-space's part is exact (Boussinesq's solution integrated over a rectangle; Love 1929). The layer's is the inverse Hankel
    transform of `layer_factor` - 1, which is smooth on the scale of the thickness.
    """
    y, x = (np.arange(count) * size for count, size in zip(shape, pitch, strict=True))
    bond = np.zeros(shape)
    for sign_y, sign_x in product(GAUSS, GAUSS):  # a mean over the cell
        distance = np.hypot(y[:, None] + sign_y * pitch[0], x[None] + sign_x * pitch[1]) / thickness
        bond += np.where(distance < REACH, _bond(poisson)(np.minimum(distance, REACH)), -1 / np.maximum(distance, REACH)) / 4
    displacement = _half_space(shape, pitch) + bond * (pitch[0] * pitch[1] / (np.pi * thickness))
    displacement.flags.writeable = False
    return np.asarray(displacement)


def layer_factor(wave: Floats, poisson: float) -> Array:  # (...) 0 to 1
    """Compute the displacement of a bonded layer under a wave of pressure, relative to a half-space's, 2 p / (q E / (1 - poisson²)).

    `wave` is the wave number times the thickness. In plane strain, on a rigid base, it is (Johnson, Contact Mechanics, 1985, 5.8)
    (2k sinh 2a - 4a) / (2k cosh 2a + 1 + k² + 4a²), k = 3 - 4 poisson, a = wave.
    """
    k, small = 3 - 4 * poisson, np.exp(-2 * np.asarray(wave, np.longdouble))  # extended: the same bits on every processor
    above = k * (1 - small**2) - 4 * wave * small
    return np.asarray(above / (k * (1 + small**2) + (1 + k**2 + 4 * np.square(wave)) * small), np.float64)


@lru_cache(maxsize=8)
def _bond(poisson: float) -> "scipy.interpolate.CubicSpline":
    """Compute the correction of a half-space's 1/r for the rigid base, by distance in thicknesses: the integral of (factor - 1) J0(a r)."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    wave, weights = (nodes + 1) * WAVES / 2, weights * WAVES / 2
    distance = np.linspace(0, REACH, int(REACH * KNOTS_PER_THICKNESS) + 1)
    weighted = weights * (layer_factor(wave, poisson) - 1)
    return scipy.interpolate.CubicSpline(distance, (scipy.special.j0(distance[:, None] * wave) * weighted).sum(axis=1))


@lru_cache(maxsize=8)
def _half_space(shape: tuple[int, int], pitch: tuple[float, float]) -> Array:
    """Integrate 1 / (pi r) over a cell, seen from the middles of the cells of a grid."""
    y, x = (np.arange(count, dtype=np.longdouble) * size for count, size in zip(shape, pitch, strict=True))
    total = np.zeros(shape, np.longdouble)
    for sign_y, sign_x in product((1, -1), (1, -1)):
        v, u = y[:, None] + sign_y * pitch[0] / 2, x[None] + sign_x * pitch[1] / 2
        total += sign_y * sign_x * (u * np.arcsinh(v / np.abs(u)) + v * np.arcsinh(u / np.abs(v)))
    return np.asarray(total / np.pi, np.float64)
