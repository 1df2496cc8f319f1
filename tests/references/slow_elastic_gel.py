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


def slow_spread(pressure: np.ndarray, pressed: np.ndarray, factor: int) -> np.ndarray:
    """Spread the pressure on each cell over its pressed pixels, falling to the lesser neighbour, with the cell's force."""
    offsets = (np.arange(factor) + 0.5) / factor - 0.5
    fine = repeated(pressure, factor)
    for axis in (0, 1):
        edges = np.diff(pressure, axis=axis, prepend=np.take(pressure, [0], axis), append=np.take(pressure, [-1], axis))
        before, after = np.delete(edges, -1, axis), np.delete(edges, 0, axis)
        slope = np.where(before * after > 0, np.sign(after) * np.minimum(np.abs(before), np.abs(after)), 0)
        steps = np.tile(offsets, pressure.shape[axis])
        fine += repeated(slope, factor) * (steps[:, None] if axis == 0 else steps[None])
    rows, cols = pressed.shape
    padded = np.zeros_like(fine)
    padded[:rows, :cols] = np.where(pressed, fine[:rows, :cols], 0)
    means = padded.reshape(pressure.shape[0], factor, -1, factor).mean(axis=(1, 3))
    share = np.divide(pressure, means, out=np.zeros_like(pressure), where=pressure > 0)
    return (padded * repeated(share, factor))[:rows, :cols]


def slow_refine(coarse: np.ndarray, factor: int, shape: tuple[int, int]) -> np.ndarray:
    """Interpolate by cubics of Catmull and Rom along both axes; beyond the rim, along a line."""
    for axis in (0, 1):
        cells = coarse.shape[axis]
        at = (np.arange(shape[axis]) + 0.5) / factor - 0.5
        first, t = np.floor(at).astype(int) - 1, at % 1
        weights = [t * (-0.5 + t * (1 - t / 2)), 1 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2 - 1.5 * t)), t * t * (-0.5 + t / 2)]
        fine = np.zeros(tuple(np.insert(np.delete(coarse.shape, axis), axis, shape[axis])))
        for k, weight in enumerate(weights):
            inside = np.clip(first + k, 0, cells - 1)
            towards = np.clip(inside - np.sign(first + k - inside), 0, cells - 1)
            rim, inner = np.take(coarse, inside, axis), np.take(coarse, towards, axis)
            beyond, weight = (part[:, None] if axis == 0 else part[None] for part in (np.abs(first + k - inside), weight))
            fine += weight * (rim + beyond * (rim - inner))
        coarse = fine
    return coarse


def repeated(cells: np.ndarray, factor: int) -> np.ndarray:
    return np.repeat(np.repeat(cells, factor, axis=0), factor, axis=1)
