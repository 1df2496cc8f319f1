"""How much of an object's weight the contacts of a grasp cannot carry, whichever way gravity points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.compiled import compiled

Float64Array = NDArray[np.float64]

EDGES = 6
"""Edges of the pyramid that stands for a friction cone."""
MAX_FORCE = 10.0
"""Largest force of an edge, in weights of the object: 20 N for an object of 0.2 kg."""
LEVER = 0.05
"""m, by which moments are divided so that they count like forces: half the size of a held object."""
CONTACT_RADIUS = 0.004
"""m, radius of a gel's contact, which resists turning about its normal."""
SWEEPS, SLOW = 200, 1e-3
"""Most rounds over all forces; share of the squared residual below which its fall in a round counts as convergence."""
SMALL = 1e-3
"""Share of the weight below which a residual counts as 0."""
RESIDUAL_STEP = 0.02
"""Share of the weight within which residuals count as equal, and the number of touches decides."""


class Load(NamedTuple):
    """The load of a grasp: its residual in whole `RESIDUAL_STEP`s, and its number of contacts."""

    steps: int
    touches: int


NO_LOAD = Load(1000, -1)
"""Worse than any grasp's."""


@compiled
def load_residual(points: Float64Array, normals: Float64Array, touching: NDArray[np.bool_], friction: float) -> float:
    """Compute the part of an object's weight that a grasp cannot carry, along ± x, ± y and ± z.

    Parameters
    ----------
    points, normals
        (C, 3) of C contacts, m, from the centre of mass; unit normals into the object.
    touching
        (C,) which of them exist.
    friction
        Coefficient of every contact.

    Returns
    -------
    The root mean square, over six directions, of the force and moment (divided by `LEVER`) that remain, as a share of the weight. 0: held
    in all; 1: not held at all.

    Notes
    -----
    Least squares over forces within the friction cones, the pyramids' edges and the moments of a soft finger, one force after the other
    (coordinate descent).
    """
    return _residual(_columns(points, normals, touching, friction), np.inf, np.arange(6))


@compiled
def lightest_grasp(
    points: Float64Array, normals: Float64Array, touching: NDArray[np.bool_], friction: float, best: Load
) -> tuple[int, Load]:
    """Find the grasp that carries an object best: the least steps of its residual, then the most touches, then the first.

    Parameters
    ----------
    points, normals, touching, friction
        (N, C, …) of N grasps, as for `load_residual`.
    best
        The load to surpass; any grasp surpasses `NO_LOAD`.

    Returns
    -------
    The grasp's number and its load; -1 and `best` where none surpasses it.

    Notes
    -----
    A residual is given up as soon as some directions alone make it too large; the last of these comes first for the next grasp.
    """
    number, steps, best_touches = -1, best.steps, best.touches
    order = np.arange(6)
    for n in range(len(points)):
        touches = int(touching[n].sum())
        limit = steps if touches > best_touches else steps - 1
        if limit >= 0:
            residual = _residual(_columns(points[n], normals[n], touching[n], friction), (limit + 1) * RESIDUAL_STEP, order)
            if residual < np.inf and residual // RESIDUAL_STEP <= limit:
                number, steps, best_touches = n, int(residual // RESIDUAL_STEP), touches
    return number, Load(steps, best_touches)


@compiled
def _columns(points: Float64Array, normals: Float64Array, touching: NDArray[np.bool_], friction: float) -> Float64Array:
    """Compute the wrenches (M, 6) of all existing contacts."""
    columns = np.empty((len(points) * (EDGES + 2), 6))
    count = 0
    for c in range(len(points)):
        if touching[c]:
            _cone(points[c], normals[c], friction, columns[count : count + EDGES + 2])
            count += EDGES + 2
    return columns[:count]


@compiled
def _cone(point: Float64Array, normal: Float64Array, friction: float, columns: Float64Array) -> None:
    """Fill the wrenches (EDGES + 2, 6) of a contact with normal force 1: forces on its cone, and moments about its normal."""
    thin = 0
    for k in range(1, 3):
        if abs(normal[k]) < abs(normal[thin]):
            thin = k
    across = np.zeros(3)
    across[thin] = 1.0
    along = _cross(normal, across)
    along /= np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    across = _cross(along, normal)
    twist = 2 / 3 * friction * CONTACT_RADIUS / LEVER
    half, high = 0.5, np.sqrt(0.75)  # corners of a hexagon
    for edge in range(EDGES + 2):
        force = normal.copy()
        if edge < EDGES:
            cosine = (1.0, half, -half, -1.0, -half, half)[edge]
            sine = (0.0, high, high, 0.0, -high, -high)[edge]
            force += friction * (cosine * along + sine * across)
        columns[edge, :3] = force
        columns[edge, 3:] = _cross(point, force) / LEVER
    columns[EDGES, 3:] += twist * normal
    columns[EDGES + 1, 3:] -= twist * normal


@compiled
def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _residual(columns: Float64Array, limit: float, order: NDArray[np.intp]) -> float:
    """Compute the root mean square residual of unit forces in six directions against wrenches (M, 6), each scaled by 0 to `MAX_FORCE`.

    Returns infinity if some directions, taken in `order`, reach `limit` alone; the last of them then becomes the first of `order`.
    """
    if not len(columns):
        return 1.0
    squares = (columns**2).sum(axis=1)
    squares_left = np.zeros(6)
    force, remainder = np.empty(len(columns)), np.empty(6)
    for place in range(6):
        direction = order[place]
        force[:] = 0.0
        remainder[:] = 0.0
        remainder[direction // 2] = 1.0 if direction % 2 else -1.0
        squared = 1.0
        for _ in range(SWEEPS):
            for m in range(len(columns)):
                slope = 0.0
                for k in range(6):
                    slope += columns[m, k] * remainder[k]
                updated = min(max(force[m] - slope / squares[m], 0.0), MAX_FORCE)
                for k in range(6):
                    remainder[k] += (updated - force[m]) * columns[m, k]
                force[m] = updated
            previous, squared = squared, 0.0
            for k in range(6):
                squared += remainder[k] * remainder[k]
            if squared < SMALL * SMALL or previous - squared < SLOW * squared:
                break
        squares_left[direction] = squared
        if np.sqrt(squares_left.sum() / 6) >= limit * (1 + 1e-9):  # beyond the rounding of the sum
            order[1 : place + 1] = order[:place].copy()
            order[0] = direction
            return np.inf
    return float(np.sqrt(squares_left.sum() / 6))
