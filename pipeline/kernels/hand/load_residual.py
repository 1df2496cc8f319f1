"""How much of an object's weight the contacts of a grasp cannot carry, whichever way gravity points."""

from typing import NamedTuple

import numpy as np

from pipeline.kernels.arrays import Array, Indices, Mask
from pipeline.kernels.compiled import compiled

HIGH = float(np.sqrt(0.75))
HEXAGON = np.array([[1, 0], [0.5, HIGH], [-0.5, HIGH], [-1, 0], [-0.5, -HIGH], [0.5, -HIGH]])  # edges of a friction pyramid
MAX_FORCE = 10.0  # largest force of an edge, in weights of the object: 20 N for an object of 0.2 kg
LEVER = 0.05  # m, by which moments are divided so that they count like forces: half the size of a held object
CONTACT_RADIUS = 0.004  # m, radius of a gel's contact, which resists turning about its normal
STEPS = 200  # most steps of a solution: in 1.8 million of random and degenerate grasps the most were 112, the mean 4.5
PERPENDICULAR = 1e-7  # cosine between wrench and remaining load below which the wrench's force cannot reduce the load
SMALL = 1e-4  # share of the weight below which a residual counts as 0
RESIDUAL_STEP = 0.02  # share of the weight within which residuals count as equal, and the number of touches decides


class Support(NamedTuple):
    """How well a grasp supports an object."""

    steps: int  # its residual in whole `RESIDUAL_STEP`s
    touches: int  # its number of contacts


NO_SUPPORT = Support(1000, -1)  # worse than any grasp's


@compiled
def load_residual(
    points: Array,  # (C, 3) of C contacts, from the centre of mass, m
    normals: Array,  # (C, 3) unit, into the object
    touching: Mask,  # (C,) which contacts exist
    friction: float,  # coefficient of every contact
) -> float:  # 0: held in all directions; 1: not held at all
    """Compute the part of an object's weight that a grasp cannot carry, along ± x, ± y and ± z.

    It is the root mean square, over six directions, of the force and moment (divided by `LEVER`) that remain, as a share of the weight.
    Least squares over forces within the friction cones: the pyramids' edges and the moments of a soft finger, each 0 to `MAX_FORCE`.
    """
    radii = np.full(len(points), CONTACT_RADIUS)
    columns = contact_wrenches(points[touching], normals[touching], radii, HEXAGON, friction, LEVER)
    squared = 0.0
    for axis in range(3):
        for sign in (1.0, -1.0):
            load = np.zeros(6)
            load[axis] = sign
            squared += _least_squared(columns, load)
    return float(np.sqrt(squared / 6))


@compiled
def best_supporting_grasp(
    points: Array,  # (N, C, 3) of N grasps, each as for `load_residual`
    normals: Array,  # (N, C, 3)
    touching: Mask,  # (N, C)
    friction: float,
    best: Support,  # to surpass; any grasp surpasses `NO_SUPPORT`
) -> tuple[int, Support]:  # its number, -1 where none surpasses `best`
    """Find the grasp that supports an object best, and its support: least steps of the residual, most touches, then the first."""
    number, steps, best_touches = -1, best.steps, best.touches
    for n in range(len(points)):
        touches = int(touching[n].sum())
        limit = steps if touches > best_touches else steps - 1
        if limit >= 0:
            own_steps = int(load_residual(points[n], normals[n], touching[n], friction) // RESIDUAL_STEP)
            if own_steps <= limit:
                number, steps, best_touches = n, own_steps, touches
    return number, Support(steps, best_touches)


@compiled
def contact_wrenches(
    points: Array,  # (C, 3) of contacts, from the origin of moments, m
    normals: Array,  # (C, 3) unit, into the object
    radii: Array,  # (C,) of contacts, which resist turning about their normals, m
    directions: Array,  # (E, 2) unit vectors to the edges of the pyramid that approximates a friction cone
    friction: float,
    lever: float,  # by which moments are divided so that they count like forces, m
) -> Array:  # (C (E + 2), 6) force and moment
    """Compute the wrenches of soft fingers, each with normal force 1: forces on its cone, and moments about its normal."""
    edges = len(directions)
    wrenches = np.empty((len(points) * (edges + 2), 6))
    for c in range(len(points)):
        normal, own = normals[c], wrenches[c * (edges + 2) : (c + 1) * (edges + 2)]
        thin = 0
        for k in range(1, 3):
            if abs(normal[k]) < abs(normal[thin]):
                thin = k
        across = np.zeros(3)
        across[thin] = 1.0
        along = _cross(normal, across)
        along /= np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
        across = _cross(along, normal)
        for edge in range(edges + 2):
            force = normal.copy()
            if edge < edges:
                force += friction * (directions[edge, 0] * along + directions[edge, 1] * across)
            own[edge, :3] = force
            own[edge, 3:] = _cross(points[c], force) / lever
        twist = 2 / 3 * friction * radii[c] / lever
        own[edges, 3:] += twist * normal
        own[edges + 1, 3:] -= twist * normal
    return wrenches


@compiled
def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _least_squared(columns: Array, load: Array) -> float:
    """Compute the least squared length of a load (6,) plus wrenches (M, 6), each scaled by 0 to `MAX_FORCE`.

    An active-set method (Stark and Parker 1995, "Bounded-variable least squares"): one force after the other leaves its bound, the steepest
    first. The free forces go to their unbounded minimum, or towards it until one of them reaches a bound and stays there.
    """
    lengths = np.sqrt((columns**2).sum(axis=1))
    force, is_free = np.zeros(len(columns)), np.zeros(len(columns), np.bool_)
    free, count = np.empty(6, np.intp), 0  # in the order in which they became free: each wrench is independent of those before it
    remainder, at_minimum = load.copy(), True
    for _ in range(STEPS):
        if at_minimum:
            entering = _steepest(columns, lengths, force, is_free, remainder)
            if entering < 0 or count == 6:
                break
            free[count], is_free[entering] = entering, True
            count += 1
        change = _unbounded_change(columns, free[:count], remainder)
        share, blocking = 1.0, -1
        for i in range(count):
            room = MAX_FORCE - force[free[i]] if change[i] > 0.0 else force[free[i]]
            if share * abs(change[i]) > room:
                share, blocking = room / abs(change[i]), i
        for i in range(count):
            m = free[i]
            updated = min(max(force[m] + share * change[i], 0.0), MAX_FORCE)
            if i == blocking:  # exactly at its bound
                updated = MAX_FORCE if change[i] > 0.0 else 0.0
            for k in range(6):
                remainder[k] += (updated - force[m]) * columns[m, k]
            force[m] = updated
        at_minimum = blocking < 0
        if not at_minimum:
            is_free[free[blocking]] = False
            count -= 1
            for i in range(blocking, count):
                free[i] = free[i + 1]
    return _dot(remainder, remainder)


@compiled
def _steepest(columns: Array, lengths: Array, force: Array, is_free: Mask, remainder: Array) -> int:
    """Find the force at a bound whose change reduces the remainder (6,) most steeply; -1 where none does, or it counts as 0."""
    length = np.sqrt(_dot(remainder, remainder))
    steepest, number = PERPENDICULAR * length, -1
    for m in range(len(columns)):
        if not is_free[m]:
            slope = _dot(columns[m], remainder) / lengths[m]
            descent = slope if force[m] > 0.0 else -slope  # from the upper bound down, from 0 up
            if descent > steepest:
                steepest, number = descent, m
    return number if length >= SMALL else -1


@compiled
def _unbounded_change(columns: Array, free: Indices, remainder: Array) -> Array:
    """Solve for the changes (K,) of the free forces that minimise the remainder (6,), by modified Gram-Schmidt."""
    count = len(free)
    basis, upper, change, left = np.empty((count, 6)), np.empty((count, count)), np.empty(count), remainder.copy()
    for i in range(count):
        own = basis[i]
        for k in range(6):
            own[k] = columns[free[i], k]
        for j in range(i):
            upper[j, i] = _dot(basis[j], own)
            for k in range(6):
                own[k] -= upper[j, i] * basis[j, k]
        upper[i, i] = np.sqrt(_dot(own, own))
        own /= upper[i, i]
        change[i] = -_dot(own, left)
        for k in range(6):
            left[k] += change[i] * own[k]
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            change[i] -= upper[i, j] * change[j]
        change[i] /= upper[i, i]
    return change


@compiled
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for k in range(6):
        total += a[k] * b[k]
    return total
