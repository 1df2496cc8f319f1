"""Residual load that contacts cannot carry: closed forms, and scipy's solver."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pipeline.kernels.hand.load_residual import (
    CONTACT_RADIUS,
    HEXAGON,
    LEVER,
    MAX_FORCE,
    NO_SUPPORT,
    RESIDUAL_STEP,
    Support,
    best_supporting_grasp,
    load_residual,
)


def residual(points: np.ndarray, normals: np.ndarray, friction: float) -> float:
    points, normals = np.asarray(points, float), np.asarray(normals, float)
    return load_residual(points, normals, np.ones(len(points), bool), friction)


def slow_residual(points: np.ndarray, normals: np.ndarray, friction: float) -> float:
    """Solve the same with scipy, on its own wrenches; the first friction edge is perpendicular to the normal's least component."""
    columns = []
    for point, normal in zip(points, normals, strict=True):
        first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        first /= np.linalg.norm(first)
        for angle in np.arange(len(HEXAGON)) * 2 * np.pi / len(HEXAGON):
            force = normal + friction * (np.cos(angle) * first + np.sin(angle) * np.cross(first, normal))
            columns.append([*force, *np.cross(point, force) / LEVER])
        for sign in (1, -1):
            twist = sign * 2 / 3 * friction * CONTACT_RADIUS * normal
            columns.append([*normal, *(np.cross(point, normal) + twist) / LEVER])
    loads = np.concatenate([np.eye(6)[:3], -np.eye(6)[:3]])
    return float(np.sqrt(np.mean([2 * lsq_linear(np.array(columns).T, load, (0, MAX_FORCE), method="bvls").cost for load in loads])))


def test_two_opposed_contacts_resist_all_loads_with_friction_and_one_axis_without() -> None:
    points, normals = [[0.03, 0, 0], [-0.03, 0, 0]], [[-1, 0, 0], [1, 0, 0]]
    assert residual(points, normals, 0.5) < 1e-3
    assert residual(points, normals, 0.0) == pytest.approx(np.sqrt(4 / 6), abs=1e-3)


def random_grasps(rng: np.random.Generator, count: int, contacts: int) -> np.ndarray:
    """(count, contacts, 3) unit vectors outward."""
    outward = rng.normal(size=(count, contacts, 3))
    return np.asarray(outward / np.linalg.norm(outward, axis=2, keepdims=True))


@pytest.mark.parametrize("friction", [0.0, 1e-6, 0.5, 100.0])
@pytest.mark.parametrize("lever", [0.0, 1e-6, 0.04, 10.0])
def test_residuals_equal_bounded_least_squares(rng: np.random.Generator, friction: float, lever: float) -> None:
    for contacts in (1, 1, 2, 3, 4, 6):
        points, normals = lever * random_grasps(rng, 1, contacts)[0], random_grasps(rng, 1, contacts)[0]
        assert residual(points, normals, friction) == pytest.approx(slow_residual(points, normals, friction), abs=1e-3)


@pytest.mark.parametrize("friction", [0.3, 0.5, 1.0])
def test_lightest_grasp_is_that_of_all_residuals(rng: np.random.Generator, friction: float) -> None:
    """Grasps that cannot win are skipped, which does not change the choice."""
    wins = 0
    for count in (1, 40, 40, 40):
        outward = random_grasps(rng, count, 4)
        touching = rng.random((count, 4)) < 0.8
        loads = [
            (int(load_residual(0.04 * own, -own, there, friction) // RESIDUAL_STEP), -int(there.sum()))
            for own, there in zip(outward, touching, strict=True)
        ]
        best = min(range(count), key=loads.__getitem__)
        number, load = best_supporting_grasp(0.04 * outward, -outward, touching, friction, NO_SUPPORT)
        assert (number, load) == (best, (loads[best][0], -loads[best][1]))
        assert best_supporting_grasp(0.04 * outward, -outward, touching, friction, load) == (-1, load)
        steps, touches = load
        assert best_supporting_grasp(0.04 * outward, -outward, touching, friction, Support(steps, touches - 1)) == (best, load)
        wins += best > 0
    assert wins
