"""How the surface of an elastic layer on a rigid plate moves in its own plane, under tangential traction and under pressure.

The counterpart of `elastic_layer`, in its units: the layer's plane-strain modulus E / (1 - poisson²) is 1 Pa.
"""

from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array, Array32, Floats
from pipeline.kernels.compiled import compiled
from pipeline.kernels.touch.elastic_contact import Layer, from_waves, periodic_waves, to_waves
from pipeline.kernels.touch.elastic_layer import GAUSS, KNOTS_PER_THICKNESS, NODES, REACH, WAVES

MIRRORED = (1, 1), (1, 1), (-1, -1), (1, -1), (-1, 1)  # signs of `shear_influence` at the opposite offset along y, and along x


def wave_factors(wave: Floats, poisson: float) -> Array:  # (3, ...)
    """Compute displacements of a bonded layer under waves of traction along them, of traction across them, and of pressure.

    `wave` is the wave number q times the thickness. Displacements have the direction of the traction, those by pressure point along the
    wave, to where it presses; all are relative to 2 / q, that of a half-space by pressure along its normal. In plane strain, with
    a = wave, k = 3 - 4 poisson and D = 2k cosh 2a + 1 + k² + 4a², they are (2k sinh 2a + 4a) / D, tanh a / (1 - poisson), and
    (2k (k - 1) (cosh 2a - 1) - 8a²) / ((k + 1) D).
    """
    a = np.asarray(wave, np.longdouble)  # extended: the same bits on every processor
    k, small = 3 - 4 * poisson, np.exp(-2 * a)
    below = k * (1 + small**2) + (1 + k**2 + 4 * a**2) * small
    along = (k * (1 - small**2) + 4 * a * small) / below
    across = (1 - small) / (1 + small) / (1 - poisson)
    pressed = (k * (k - 1) * (1 - small) ** 2 - 8 * a**2 * small) / ((k + 1) * below)
    return np.asarray([along, across, pressed], np.float64)


@lru_cache(maxsize=8)
def shear_influence(
    shape: tuple[int, int],  # rows and columns of the grid
    pitch: tuple[float, float],  # size of a cell along y and x, m
    poisson: float,  # 0 to 0.5
    thickness: float,  # of the layer, m
) -> Array:  # (5, rows, cols) m, read-only
    """Compute how a uniform traction or pressure on one cell moves the cells of a grid.

    [:, i, j] are displacements in the middle of the cell i rows and j columns away: along x by a traction of 1 Pa along x, along y by one
    along y, along y by one along x (and the other way round), along x and along y by a pressure. The half-space's part is exact (Cerruti's
    and Boussinesq's solutions integrated over a rectangle), the layer's are Hankel transforms of its factors less a half-space's.
    """
    y, x = (np.arange(count) * size for count, size in zip(shape, pitch, strict=True))
    moved = np.zeros((5, *shape))
    for sign_y, sign_x in product(GAUSS, GAUSS):  # a mean over the cell
        v, u = y[:, None] + sign_y * pitch[0], x[None] + sign_x * pitch[1]
        distance = np.hypot(u, v)
        mean, twofold, outwards = _corrections(poisson)(np.minimum(distance / thickness, REACH)).transpose(2, 0, 1)
        cosine, sine = u / distance, v / distance
        change = twofold * (cosine**2 - sine**2)
        moved += [mean + change, mean - change, 2 * twofold * cosine * sine, outwards * cosine, outwards * sine]
    moved *= pitch[0] * pitch[1] / (4 * np.pi * thickness)
    moved += _half_space(shape, pitch, poisson)
    moved[:, np.hypot(y[:, None], x[None]) >= REACH * thickness] = 0
    moved.flags.writeable = False
    return moved


@lru_cache(maxsize=8)
def _corrections(poisson: float) -> "scipy.interpolate.CubicSpline":
    """Integrate a layer's factors less a half-space's, by distance in thicknesses: mean over directions, twofold part, of pressure."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    wave, weights = (nodes + 1) * WAVES / 2, weights * WAVES / 2
    half_space = np.array([1, 1 / (1 - poisson), (1 - 2 * poisson) / (2 * (1 - poisson))])
    along, across, pressed = (wave_factors(wave, poisson) - half_space[:, None]) * weights
    distance = np.linspace(0, REACH, int(REACH * KNOTS_PER_THICKNESS) + 1)
    phase = np.maximum(distance[:, None] * wave, 1e-9)
    j0, j1 = scipy.special.j0(phase), scipy.special.j1(phase)
    j2 = 2 * j1 / phase - j0
    integrals = [j0 * (along + across) / 2, j2 * (across - along) / 2, -j1 * pressed]
    return scipy.interpolate.CubicSpline(distance, np.stack([terms.sum(axis=1) for terms in integrals], axis=1))


def _half_space(shape: tuple[int, int], pitch: tuple[float, float], poisson: float) -> Array:  # (5, rows, cols)
    """Integrate a half-space's displacements over a cell: differences between its corners."""
    y, x = (np.arange(count, dtype=np.longdouble) * size for count, size in zip(shape, pitch, strict=True))
    total, pull = np.zeros((5, *shape), np.longdouble), (1 - 2 * poisson) / 2
    for sign_y, sign_x in product((1, -1), (1, -1)):
        v, u = y[:, None] + sign_y * pitch[0] / 2, x[None] + sign_x * pitch[1] / 2
        radius = np.sqrt(u**2 + v**2)
        by_x, by_y = v * np.arcsinh(u / np.abs(v)), u * np.arcsinh(v / np.abs(u))
        total[0] += sign_y * sign_x * (by_x + (1 - poisson) * by_y)
        total[1] += sign_y * sign_x * (by_y + (1 - poisson) * by_x)
        total[2] -= sign_y * sign_x * poisson * radius
        total[3] -= sign_y * sign_x * pull * (v * np.log(radius) + u * np.arctan(v / u))
        total[4] -= sign_y * sign_x * pull * (u * np.log(radius) + v * np.arctan(u / v))
    return np.asarray(total / (np.pi * (1 - poisson)), np.float64)  # 2 pi times the shear modulus


class ShearConvolution(NamedTuple):
    """A convolution of vectors in single precision, by a symmetric matrix for every wave."""

    padded: tuple[int, int]  # rows and columns of the periodic grid
    matrices: Array32  # (3, padded rows, padded columns // 2 + 1) xx, yy and xy
    pull: NDArray[np.complex64]  # (2, padded rows, padded columns // 2 + 1), or () for none
    size: np.float32  # of the matrices: what the functions below say

    def __call__(self, vectors: Floats, pressure: Floats | None = None) -> Array32:  # (2, rows, cols)
        """Convolve vectors (2, rows, cols), and add the pull of a pressure (rows, cols)."""
        waves = to_waves(vectors.astype(np.float32, copy=False), self.padded)
        _multiply(self.matrices, waves)
        if pressure is not None:
            waves += self.pull * to_waves(pressure.astype(np.float32), self.padded)
        return from_waves(waves, self.padded, vectors.shape)


@compiled
def _multiply(matrices: Array32, waves: NDArray[np.complex64]) -> None:
    for row in range(waves.shape[1]):
        xx, yy, xy, x, y = matrices[0, row], matrices[1, row], matrices[2, row], waves[0, row], waves[1, row]
        for col in range(len(x)):
            x[col], y[col] = xx[col] * x[col] + xy[col] * y[col], xy[col] * x[col] + yy[col] * y[col]


@lru_cache(maxsize=16)
def shear_displacement(window: tuple[int, int], grid: tuple[int, int], layer: Layer) -> ShearConvolution:
    """Compute displacements by traction and pressure in a window of a grid, without wrapping around; size: the largest eigenvalue."""
    rows, cols = window
    padded = (2 * scipy.fft.next_fast_len(rows, real=True), 2 * scipy.fft.next_fast_len(cols, real=True))
    kernels = np.zeros((5, *padded), np.float32)
    for kernel, quarter, (along_y, along_x) in zip(kernels, shear_influence(grid, *layer), MIRRORED, strict=True):
        kernel[:rows, :cols] = quarter[:rows, :cols]
        kernel[padded[0] - rows + 1 :, :cols] = along_y * kernel[rows - 1 : 0 : -1, :cols]
        kernel[:, padded[1] - cols + 1 :] = along_x * kernel[:, cols - 1 : 0 : -1]
    waves = scipy.fft.rfft2(kernels)
    xx, yy, xy = matrices = np.ascontiguousarray(waves[:3].real)
    return ShearConvolution(padded, matrices, waves[3:], ((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)).max())


@lru_cache(maxsize=16)
def shear_stiffness(window: tuple[int, int], layer: Layer) -> ShearConvolution:
    """Compute an approximate inverse of `shear_displacement`: periodic, with a margin between the rims; size: the mean of a diagonal."""
    pitch, poisson, thickness = layer
    padded, y, x, wave = periodic_waves(window, pitch)
    knots = WAVES * np.linspace(1e-3, 1, 200) ** 3  # a table is exact enough, and faster
    along, across = (wave / (2 * np.interp(wave * thickness, knots, factor)) for factor in wave_factors(knots, poisson)[:2])
    matrices = np.stack([along * x**2 + across * y**2, along * y**2 + across * x**2, (along - across) * x * y]) / wave**2
    matrices[:2, 0, 0] = across[0, 0]  # the mean has no direction
    return ShearConvolution(padded, matrices.astype(np.float32), np.zeros((), np.complex64), np.float32(matrices[:2].mean()))
