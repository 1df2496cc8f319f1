"""An elastic layer pressed by a rigid object: every cell's influence on every other integrated, and the contact by active sets (NNLS)."""

import numpy as np
from scipy.integrate import quad
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls
from scipy.special import j0

POINTS = 3
"""Gauss points per cell and axis for the part of the kernel that is smooth."""


def slow_press(pressed: np.ndarray, pitch: tuple[float, float], *, modulus: float, poisson: float, thickness: float) -> tuple:
    """Return (indentation, pressure), each (rows, cols): m and Pa."""
    rows, cols = pressed.shape
    middles = np.array([(row * pitch[0], col * pitch[1]) for row in range(rows) for col in range(cols)])
    compliance = np.empty((len(middles), len(middles)))
    known: dict[tuple[float, float], float] = {}
    for i, there in enumerate(middles):
        for j, here in enumerate(middles):
            offset = tuple(np.round(np.abs(there - here) / pitch).astype(int))
            if offset not in known:
                known[offset] = cell_displacement(np.multiply(offset, pitch), pitch, poisson, thickness)
            compliance[i, j] = known[offset] * (1 - poisson**2) / modulus
    below = pressed.ravel() > 0
    inside = compliance[np.ix_(below, below)]
    lower = cholesky(inside, lower=True)  # p·Gp/2 - p·h = |L'p - L⁻¹h|²/2 + const.
    pressure = np.zeros(rows * cols)
    pressure[below] = nnls(lower.T, solve_triangular(lower, pressed.ravel()[below], lower=True))[0]
    return (compliance @ pressure).reshape(rows, cols), pressure.reshape(rows, cols)


def cell_displacement(offset: np.ndarray, pitch: tuple[float, float], poisson: float, thickness: float) -> float:
    """Displacement at a distance from the middle of a cell under unit pressure, where E / (1 - poisson²) is 1."""
    corners = [(offset[0] + s * pitch[0] / 2, offset[1] + t * pitch[1] / 2, s * t) for s in (1, -1) for t in (1, -1)]
    half = sum(sign * (x * np.log(y + np.hypot(x, y)) + y * np.log(x + np.hypot(x, y))) for y, x, sign in corners) / np.pi
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    bond = 0.0
    for v, a in zip(nodes, weights, strict=True):
        for u, b in zip(nodes, weights, strict=True):
            distance = np.hypot(offset[0] + v * pitch[0] / 2, offset[1] + u * pitch[1] / 2)
            bond += a * b / 4 * bonded(distance, poisson, thickness)
    return half + pitch[0] * pitch[1] * bond


def bonded(distance: float, poisson: float, thickness: float) -> float:
    """Integrate the reduction by the rigid base of the displacement at a distance from a force of 1 N, where E / (1 - poisson²) is 1."""

    def integrand(q: float) -> float:
        a, k = q * thickness, 3 - 4 * poisson
        layer = (2 * k * np.sinh(2 * a) - 4 * a) / (2 * k * np.cosh(2 * a) + 1 + k**2 + 4 * a**2)
        return (layer - 1) * float(j0(q * distance)) / np.pi

    return quad(integrand, 0, 20 / thickness, limit=400, epsabs=1e-9 / thickness)[0]
