"""Exact depth against intersection in fractions: slivers, walls, rays through corners and edges, any scale."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given

from pipeline.kernels.touch.ray_depth import box_faces, local_depth, ray_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from tests.kernels.touch.shapes import SENSOR, coarse
from tests.references.exact_arithmetic import intersect_ray
from tests.strategies import EPS, random_rotation, seeds, sliver

SMALL = coarse(6)
X, Y = pixel_centres(SMALL)
HEIGHTS = (0.001, 0.03)
RAY_TOLERANCE = 1e-15
"""Sensor widths: distance between a pixel's ray and the ray that float64 arithmetic intersects, for faces in the sensor frame."""


def slivers(rng: np.random.Generator) -> np.ndarray:
    """Make a face 10^8 times as long as it is high, its middle on a ray."""
    face = 0.02 * sliver(1e8, rng)
    return face + [rng.choice(X), rng.choice(Y), 0.01] - face.mean(axis=0)


def walls(rng: np.random.Generator) -> np.ndarray:
    """Make a face all but parallel to the rays, that a ray hits."""
    across = random_rotation(rng)[0, :2]
    spread = np.outer(rng.uniform(-0.005, 0.005, 3), across) + rng.normal(size=(3, 2)) * 1e-10
    return np.column_stack([[rng.choice(X), rng.choice(Y)] + spread - spread.mean(axis=0), rng.uniform(*HEIGHTS, 3)])


def cornered(rng: np.random.Generator) -> np.ndarray:
    """Make a face with corners and edges on rays."""
    return np.column_stack([rng.choice(X, 3), rng.choice(Y, 3), rng.uniform(*HEIGHTS, 3)])


def any_face(rng: np.random.Generator) -> np.ndarray:
    return np.column_stack([rng.uniform(-0.01, 0.01, (3, 2)), rng.uniform(*HEIGHTS, 3)])


def height_of(face: np.ndarray) -> float:
    """Least height of a face seen along z, m: so much a weight of 1 is."""
    flat = face[:, :2]
    edges = np.linalg.norm(flat - np.roll(flat, 1, axis=0), axis=1)
    (ux, uy), (vx, vy) = flat[1] - flat[0], flat[2] - flat[0]
    return float(abs(ux * vy - uy * vx) / edges.max())


@pytest.mark.parametrize("make", [any_face, slivers, walls, cornered])
@given(seed=seeds)
def test_depth_is_that_of_a_ray_within_the_tolerance(make, seed) -> None:
    face = make(np.random.default_rng(seed))
    depth = local_depth(np.ascontiguousarray(face.T[:, :, None]), SMALL)
    aside = RAY_TOLERANCE * SMALL.width
    for row, y in enumerate(Y):
        for col, x in enumerate(X):
            met = intersect_ray(face, float(x), float(y))
            if met is None:  # edge-on: not met itself, as the contract says, or its rim is
                continue
            z, inside, slope = met
            clear = float(inside) * height_of(face)  # m from the rim, where it is not doubtful
            if np.isfinite(depth[row, col]):
                assert clear >= -aside
                assert abs(float(Fraction(float(depth[row, col])) - z)) <= 2 * float(slope) * aside + EPS * SMALL.range
            else:
                assert clear <= aside


def test_sensor_with_two_rows_and_seven_columns() -> None:
    sensor: Sensor = SENSOR.model_copy(update={"rows": 2, "cols": 7})
    floor = np.array([[[-1, -1, 0.005], [3, -1, 0.005], [-1, 3, 0.005]]])
    assert ray_depth(box_faces(floor), np.eye(4), sensor).tolist() == [[0.005] * 7] * 2
