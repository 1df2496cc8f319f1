"""Friction the slow way: a layer's waves by matrix exponentials; every cell's influence as a matrix, and FISTA (Beck and Teboulle 2009)."""

import numpy as np
from scipy.linalg import expm

from pipeline.kernels.touch.shear_layer import MIRRORED, shear_influence

ITERATIONS = 1000


def slow_wave_factors(wave: float, poisson: float) -> tuple[float, float]:
    """Along the wave, by a traction along it and by pressure: ordinary differential equations through a layer of thickness 1."""
    shear = (1 - poisson) / 2
    lame, stiff = 2 * shear * poisson / (1 - 2 * poisson), 2 * shear * (1 - poisson) / (1 - 2 * poisson)
    along = np.array([0, -wave, 1 / shear, 0])  # of the state: displacements cos(wave x), sin(wave x), tractions cos, sin
    normal = np.array([lame * wave, 0, 0, 1]) / stiff
    through = expm(np.stack([along, normal, wave**2 * stiff * np.eye(4)[0] - wave * lame * normal, wave * np.eye(4)[2]]))
    from_base = through[:, 2:]  # by the tractions at the base, which does not move
    by_shear, by_pressure = (from_base[0] @ np.linalg.solve(from_base[2:], load) for load in ([1.0, 0.0], [0.0, -1.0]))
    return by_shear * wave / 2, by_pressure * wave / 2


def slow_drag(
    pressure: np.ndarray,  # (rows, cols), where the plane-strain modulus is 1
    target: np.ndarray,  # (2, rows, cols) m, of the surface if all sticks
    friction: float,
    pitch: tuple[float, float],
    poisson: float,
    thickness: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the traction, where the plane-strain modulus is 1, and the displacement of the surface, each (2, rows, cols)."""
    cells = np.argwhere(np.ones_like(pressure))
    (i, j), influence = np.moveaxis(cells[:, None] - cells[None], -1, 0), shear_influence(pressure.shape, pitch, poisson, thickness)
    xx, yy, xy, xp, yp = (
        np.where(i < 0, along_y, 1) * np.where(j < 0, along_x, 1) * part[abs(i), abs(j)]
        for part, (along_y, along_x) in zip(influence, MIRRORED, strict=True)
    )
    matrix = np.block([[xx, xy], [xy, yy]])
    free = np.concatenate([xp, yp]) @ pressure.ravel()
    step, aim, bound = 1 / np.linalg.eigvalsh(matrix)[-1], target.ravel() - free, friction * pressure.ravel()
    traction = ahead = np.zeros(len(aim))
    momentum = 1.0
    for _ in range(ITERATIONS):
        before, last = traction, momentum
        x, y = (ahead - step * (matrix @ ahead - aim)).reshape(2, -1)
        traction = (np.stack([x, y]) * np.minimum(1, bound / np.maximum(np.hypot(x, y), 1e-300))).ravel()
        momentum = (1 + np.sqrt(1 + 4 * last**2)) / 2
        ahead = traction + (last - 1) / momentum * (traction - before)
    return traction.reshape(target.shape), (matrix @ traction + free).reshape(target.shape)
