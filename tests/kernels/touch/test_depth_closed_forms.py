"""Depth of a sphere, planes and a cube against their formulas."""

import numpy as np
import pytest

from pipeline.kernels.touch.ray_depth import box_faces, ray_depth, sphere_traced_depth
from pipeline.kernels.touch.sensor import pixel_centres
from tests.kernels.touch.shapes import SENSOR, ball, box, frame

MICRON = 1e-6
EXACT = 1e-8
TRACERS = {"ray": ray_depth, "sphere": sphere_traced_depth}
LIMITS = {"ray": EXACT, "sphere": MICRON}
X, Y = np.meshgrid(*pixel_centres(SENSOR))


pytestmark = pytest.mark.parametrize("name", list(TRACERS))


def somewhere(triangles: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Faces given in the sensor's frame moved somewhere in the world, and the sensor's pose there."""
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = frame(rng.normal(size=3), rng.uniform(0, 6)), rng.normal(size=3)
    return triangles @ pose[:3, :3].T + pose[:3, 3], pose


@pytest.mark.parametrize("radius", [0.002, 0.01, 0.05])
@pytest.mark.parametrize("subdivisions", [3, 5])
def test_depth_of_a_sphere(name: str, radius: float, subdivisions: int) -> None:
    centre = np.array([0.001, -0.0015, SENSOR.w - 0.0012 + radius])
    triangles, pose = somewhere(ball(subdivisions, radius, *centre), 0)
    depth = TRACERS[name](box_faces(triangles), pose, SENSOR)
    squared = (X - centre[0]) ** 2 + (Y - centre[1]) ** 2
    sagitta = radius - np.linalg.norm(ball(subdivisions, radius).mean(axis=1), axis=1).min()
    inside = squared < (0.8 * radius) ** 2
    closed = centre[2] - np.sqrt(radius**2 - squared[inside])
    error = (depth[inside] - closed) * np.sqrt(1 - squared[inside] / radius**2)  # along the normal, as the sagitta is
    assert error.min() >= -LIMITS[name]
    assert error.max() <= sagitta * 1.02 + MICRON
    if radius < SENSOR.width / 4:
        assert np.isinf(depth[squared > (1.001 * radius) ** 2]).all()


@pytest.mark.parametrize("degrees", [0, 20, 45, 70, 85])
def test_depth_of_a_tilted_plane(name: str, degrees: float) -> None:
    slope = np.tan(np.radians(degrees))
    corner = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    vertices = np.column_stack([corner, 0.004 + slope * corner[:, 0]])
    triangles, pose = somewhere(vertices[np.array([[0, 1, 2], [0, 2, 3]])], int(degrees))
    depth = TRACERS[name](box_faces(triangles), pose, SENSOR)
    closed = 0.004 + slope * X
    seen = (closed > 0) & (closed < SENSOR.range)
    assert np.abs(depth[seen] - closed[seen]).max() <= LIMITS[name]
    assert np.isinf(depth[~seen]).all()


def test_depth_beside_a_wall_parallel_to_the_rays(name: str) -> None:
    """Half the sensor is under a cube whose walls are parallel to the rays: the hard case of sphere tracing."""
    triangles, pose = somewhere(box((0.04, 0.04, 0.02), x=0.02 + 1e-5, z=0.015), 6)
    depth = TRACERS[name](box_faces(triangles), pose, SENSOR)
    covered = X > 1e-5
    assert np.abs(depth[covered] - 0.005).max() <= LIMITS[name]
    assert np.isinf(depth[~covered]).all()
