"""Depth by both tracers: empty, open, inside-out, doubled, tiny and distant objects, and rays through edges."""

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from pipeline.kernels.touch.ray_depth import box_faces, ray_depth, sphere_traced_depth
from pipeline.kernels.touch.sensor import pixel_centres
from tests.kernels.touch.shapes import SENSOR, coarse, pose_at, sheet

tracers = pytest.mark.parametrize("trace", [ray_depth, sphere_traced_depth])
Tracer = Callable[..., np.ndarray]


@tracers
@pytest.mark.parametrize(
    ("heights", "expected"),
    [((), np.inf), ((-0.001,), np.inf), ((0.0501,), np.inf), ((0.0,), 0.0), ((1e-12,), 0.0), ((0.05,), 0.05), ((-5e-8, 0.01), 0.01)],
)
def test_sheets_within_the_range_are_hit_and_no_others(trace: Tracer, heights: tuple[float, ...], expected: float) -> None:
    depth = trace(box_faces(np.concatenate([np.zeros((0, 3, 3)), *map(sheet, heights)])), np.eye(4), SENSOR)
    np.testing.assert_allclose(depth, expected, rtol=0, atol=1e-7)
    assert (depth >= 0).all()


@tracers
def test_rays_that_start_on_a_slanted_surface(trace: Tracer) -> None:
    """Half of the plane lies behind the sensor, and the middle column of rays starts on it."""
    sensor = coarse(25)
    plane = sheet(0.0)
    plane[..., 2] = 0.5 * plane[..., 0]
    depth = trace(box_faces(plane), np.eye(4), sensor)
    x, _ = pixel_centres(sensor)
    ahead = x >= 0
    assert np.abs(depth[:, ahead] - 0.5 * x[ahead]).max() <= 1e-7
    assert np.isinf(depth[:, ~ahead]).all()


@tracers
def test_object_smaller_than_a_pixel_is_hit_by_one_ray(trace: Tracer) -> None:
    x, y = pixel_centres(SENSOR)
    tiny = sheet(0.003, half=1e-5, x=x[17], y=y[80])
    depth = trace(box_faces(tiny), np.eye(4), SENSOR)
    assert np.argwhere(np.isfinite(depth)).tolist() == [[80, 17]]
    assert abs(depth[80, 17] - 0.003) <= 1e-7


def test_thousands_of_stacked_faces_need_bounded_memory() -> None:
    layers = np.concatenate([sheet(z) for z in np.random.default_rng(8).permutation(np.linspace(0.004, 0.04, 1500))])
    tracemalloc.start()
    depth = ray_depth(box_faces(layers), np.eye(4), SENSOR)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.abs(depth - 0.004).max() <= 1e-12
    assert peak < 300e6


@tracers
def test_depth_ignores_faces_without_area(trace: Tracer) -> None:
    x, y = pixel_centres(SENSOR)
    spot = np.array([x[30], y[40], 0.002])
    across = spot + np.array([[-0.01, 0, 0], [0, 0, 0], [0.02, 0, 0]])
    upright = spot + np.array([[0, 0, 0], [0, 0, 0.001], [0, 0, 0.002]])
    flat = np.stack([np.tile(spot, (3, 1)), upright, across + np.array([0, 1e-5, 0])])
    depth = trace(box_faces(np.concatenate([sheet(0.006), flat])), np.eye(4), SENSOR)
    assert np.abs(depth - 0.006).max() <= 1e-7


@tracers
def test_no_ray_passes_between_faces(trace: Tracer) -> None:
    """A sheet of faces whose corners and edges all lie on rays, in the plane and turned by quarter turns."""
    sensor = coarse(20)
    x, y = pixel_centres(sensor)
    grid = np.stack([*np.meshgrid(x, y), np.full((20, 20), 0.005)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    triangles = np.concatenate([np.stack(t, axis=-2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    for quarter in range(4):
        c4, s4 = np.round([np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)])
        turned = triangles @ np.array([[c4, -s4, 0], [s4, c4, 0], [0, 0, 1]]).T
        depth = trace(box_faces(turned), np.eye(4), sensor)
        assert np.abs(depth[1:-1, 1:-1] - 0.005).max() <= 1e-7


def test_ray_through_the_hub_of_a_fan_hits_it() -> None:
    """Many faces share a corner on a ray: for any rotation, one of them must be hit."""
    rng = np.random.default_rng(6)
    sensor = coarse(3)  # its middle ray starts at the origin of the sensor's frame
    for _ in range(200):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 9)) * 0.5 + np.linspace(0, np.pi, 9, endpoint=False)
        rim = np.stack([np.cos(angle), np.sin(angle), rng.normal(size=9) * 0.3], axis=1) * 0.05
        fan = np.stack([np.zeros((9, 3)), rim, np.roll(rim, -1, axis=0)], axis=1) + np.array([0, 0, 0.006])
        pose = pose_at(np.array([0, 0, 0.006]), np.array([0, 0, 1.0]), 0.006, rng.uniform(0, 6))
        assert abs(ray_depth(box_faces(fan), pose, sensor)[1, 1] - 0.006) <= 1e-9


@pytest.mark.parametrize(
    ("pose", "named"),
    [
        (np.eye(4)[:3], r"\(3, 4\)"),
        (np.full((4, 4), np.nan), "rigid"),
        (2 * np.eye(4), "rigid"),
        (np.diag([1.0, 1, -1, 1]), "rigid"),
        (pose_at(np.array([0.1, 0.2, 0.3]), np.array([0, 0, 1.0]), 0.01).T, "rigid"),
        (np.diag([1.0, 1, 1, 2]), "rigid"),
    ],
)
def test_invalid_poses_are_rejected(pose: np.ndarray, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        sphere_traced_depth(box_faces(sheet(0.01)), pose, SENSOR)


@pytest.mark.parametrize(("triangles", "named"), [(np.zeros((4, 3)), r"\(4, 3\)"), (np.full((1, 3, 3), np.nan), "NaN")])
def test_invalid_triangles_are_rejected(triangles: np.ndarray, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        box_faces(triangles)
