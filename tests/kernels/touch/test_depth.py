"""Depth by both tracers: empty, open, inside-out, doubled, tiny and distant objects, and rays through edges."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given

from pipeline.kernels.geometry.mesh import face_cross_products
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.sphere_tracing import TOLERANCE, sphere_traced_depth
from tests.kernels.touch.shapes import (
    SENSOR,
    ball,
    coarse,
    pose_at,
    pressed_ball,
    sheet,
)
from tests.strategies import EPS, aspects, offsets, seeds, sliver

tracers = pytest.mark.parametrize("trace", [ray_depth, sphere_traced_depth])
Tracer = Callable[..., np.ndarray]
SMALL = coarse(6)


@tracers
def test_depth_without_faces_is_infinite(trace: Tracer) -> None:
    assert np.isinf(trace(box_faces(np.zeros((0, 3, 3))), np.eye(4), SENSOR)).all()


@tracers
@pytest.mark.parametrize("z", [-0.001, 0.0501])
def test_surface_behind_or_out_of_range_is_not_hit(trace: Tracer, z: float) -> None:
    assert np.isinf(trace(box_faces(sheet(z)), np.eye(4), SENSOR)).all()


@tracers
@pytest.mark.parametrize("z", [0.0, 1e-12, 0.05])
def test_surface_at_either_end_of_the_range_is_hit(trace: Tracer, z: float) -> None:
    depth = trace(box_faces(sheet(z)), np.eye(4), SENSOR)
    assert np.abs(depth - z).max() <= 1e-7
    assert (depth >= 0).all()


@tracers
def test_surface_just_behind_the_sensor_plane_does_not_occlude(trace: Tracer) -> None:
    depth = trace(box_faces(np.concatenate([sheet(-5e-8), sheet(0.01)])), np.eye(4), SENSOR)
    assert np.abs(depth - 0.01).max() <= 1e-7


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


@tracers
@pytest.mark.parametrize("size", [1e-6, 1e-4])
def test_tiny_objects(trace: Tracer, size: float) -> None:
    x, y = pixel_centres(SENSOR)
    depth = trace(box_faces(ball(2, size, x[50], y[50], 0.004)), np.eye(4), SENSOR)
    assert abs(depth[50, 50] - (0.004 - size)) <= 0.05 * size + 1e-7


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
def test_open_mesh_is_hit_from_inside(trace: Tracer) -> None:
    bowl = ball(3, 0.02, z=0.003)
    bowl = bowl[(bowl[..., 2] > 0.003).all(axis=1)]
    depth = trace(box_faces(bowl), np.eye(4), SENSOR)
    assert abs(depth[50, 50] - 0.023) <= 1e-4


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


def test_invalid_poses_and_tolerances_are_refused() -> None:
    faces = box_faces(sheet(0.01))
    with pytest.raises(ValueError, match=r"shape \(3, 4\)"):
        ray_depth(faces, np.eye(4)[:3], SENSOR)
    with pytest.raises(ValueError, match="NaN"):
        ray_depth(faces, np.full((4, 4), np.nan), SENSOR)
    with pytest.raises(ValueError, match="rigid"):
        ray_depth(faces, 2 * np.eye(4), SENSOR)
    with pytest.raises(ValueError, match="rigid"):
        ray_depth(faces, np.diag([1.0, 1, -1, 1]), SENSOR)
    with pytest.raises(ValueError, match="tolerance"):
        sphere_traced_depth(faces, np.eye(4), SENSOR, tolerance=0.0)


@tracers
@given(seed=seeds, offset=offsets)
def test_pressed_depth_ignores_offset(trace, seed, offset) -> None:
    rng = np.random.default_rng(seed)
    triangles, pose = pressed_ball(rng, np.zeros(3))
    moved = pose.copy()
    moved[:3, 3] += offset
    here, there = trace(box_faces(triangles), pose, SMALL), trace(box_faces(triangles + offset), moved, SMALL)
    sure = np.minimum(here, there) < SMALL.w  # beyond, near the silhouette, a surface is too steep to compare
    allowed = 16 * EPS * np.abs(offset).max() + 1e-14 + (trace is sphere_traced_depth) * TOLERANCE
    assert np.abs(there[sure] - here[sure]).max() <= allowed


@tracers
@given(seed=seeds)
def test_depth_ignores_order_and_copies_of_faces(trace, seed) -> None:
    rng = np.random.default_rng(seed)
    triangles, pose = pressed_ball(rng, np.array([0, 0, 0.6]))
    depth = trace(box_faces(triangles), pose, SMALL)
    doubled = np.concatenate([triangles, triangles[rng.random(len(triangles)) < 0.5]])
    doubled[rng.random(len(doubled)) < 0.5] = doubled[rng.random(len(doubled)) < 0.5][:1]  # one face, hundreds of times
    mixed = rng.permutation(np.concatenate([triangles[:, rng.permutation(3)], doubled[:, rng.permutation(3)]]))
    changed = trace(box_faces(mixed), pose, SMALL)
    np.testing.assert_array_equal(np.isfinite(changed), np.isfinite(depth))
    met = np.isfinite(depth)
    assert np.abs(changed[met] - depth[met]).max() <= (TOLERANCE if trace is sphere_traced_depth else 4 * EPS)


@tracers
@pytest.mark.parametrize("across", [False, True])
def test_edge_on_plate_is_hit_at_its_nearest_point_or_missed(trace, across) -> None:
    """The plate stands edge-on over the middle column or row of rays; with a lid it is always hit."""
    sensor = coarse(5)
    plate = np.array([[[0, -0.1, 0.004], [0, 0.1, 0.004], [0, 0, 0.01]]])
    lid = np.array([[[0, -0.1, 0.004], [0, 0.1, 0.004], [1e-6, 0, 0.004]]])
    alone, covered = (
        trace(box_faces(faces[..., [1, 0, 2]] if across else faces), np.eye(4), sensor) for faces in (plate, np.concatenate([plate, lid]))
    )
    on = np.zeros(sensor.shape, bool)
    on[2 if across else slice(None), slice(None) if across else 2] = True
    np.testing.assert_allclose(covered[on], 0.004, atol=TOLERANCE)
    assert np.isinf(covered[~on]).all()
    assert np.isinf(alone[~on]).all()
    assert (np.isinf(alone[on]) | (np.abs(alone[on] - 0.004) <= TOLERANCE)).all()


@tracers
@given(seed=seeds, aspect=aspects)
def test_sliver_is_hit(trace, seed, aspect) -> None:
    """Half a metre long, across the middle ray: distances to it may be inexact, its depth may not."""
    rng = np.random.default_rng(seed)
    face = 0.5 * sliver(aspect, rng)
    normal = face_cross_products(face[None])[0]
    assume(abs(normal[2]) > 0.1 * np.linalg.norm(normal))  # a wall has other tests
    face += [0, 0, 0.01] - rng.dirichlet([3, 3, 3]) @ face
    assert trace(box_faces(face[None]), np.eye(4), coarse(3))[1, 1] == pytest.approx(0.01, abs=1.01 * TOLERANCE)
