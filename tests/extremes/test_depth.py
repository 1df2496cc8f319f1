"""Empty, open, inside-out, doubled, tiny, far away: what tracers meet besides good meshes."""

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from pipeline.kernels.touch.face_culling import box_faces, cull_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import pixel_centres, ray_origins
from pipeline.kernels.touch.sphere_tracing import sphere_traced_depth, trace_spheres
from tests.touch.scenes import SENSOR, ball, box, coarse, pose_at, pybullet_triangles, random_pose
from tests.touch.twins import brute_force

Tracer = Callable[..., np.ndarray]
tracers = pytest.mark.parametrize("trace", [ray_depth, sphere_traced_depth])
SHEET = np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]], np.float64)


def sheet(z: float, half: float = 0.1, x: float = 0, y: float = 0) -> np.ndarray:
    """Two faces: a square around (x, y, z)."""
    square: np.ndarray = SHEET * half + np.array([x, y, z])
    return square


@tracers
def test_nothing_there(trace: Tracer) -> None:
    assert np.isinf(trace(box_faces(np.zeros((0, 3, 3))), np.eye(4), SENSOR)).all()


@tracers
@pytest.mark.parametrize("z", [-0.001, 0.0501])
def test_behind_or_out_of_range(trace: Tracer, z: float) -> None:
    assert np.isinf(trace(box_faces(sheet(z)), np.eye(4), SENSOR)).all()


@tracers
@pytest.mark.parametrize("z", [0.0, 1e-12, 0.05])
def test_ends_of_the_range_count(trace: Tracer, z: float) -> None:
    depth = trace(box_faces(sheet(z)), np.eye(4), SENSOR)
    assert np.abs(depth - z).max() <= 1e-7
    assert (depth >= 0).all()


@tracers
def test_surface_just_behind_the_plane_hides_nothing(trace: Tracer) -> None:
    depth = trace(box_faces(np.concatenate([sheet(-5e-8), sheet(0.01)])), np.eye(4), SENSOR)
    assert np.abs(depth - 0.01).max() <= 1e-7


@tracers
def test_rays_start_on_a_slanted_surface(trace: Tracer) -> None:
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
def test_one_pixel(trace: Tracer) -> None:
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


@tracers
@pytest.mark.parametrize("offset", [0.0, 1.0, 1e3])
def test_offset_changes_nothing(trace: Tracer, offset: float) -> None:
    triangles = pybullet_triangles("duck.obj")
    pose = random_pose(triangles, np.random.default_rng(4))
    moved = pose.copy()
    moved[:3, 3] += offset
    sensor = coarse(30)
    here, there = trace(box_faces(triangles), pose, sensor), trace(box_faces(triangles + offset), moved, sensor)
    both = np.isfinite(here) & np.isfinite(there)
    assert (np.isfinite(here) != np.isfinite(there)).sum() <= (1 if offset else 0)  # a kilometre's rounding moves rims
    assert np.quantile(np.abs(here[both] - there[both]), 0.99) <= 2e-7


@tracers
def test_winding_duplicates_and_order_change_nothing(trace: Tracer) -> None:
    triangles = pybullet_triangles("random_urdfs/063/063.obj")
    pose = random_pose(triangles, np.random.default_rng(5))
    sensor = coarse(40)
    depth = trace(box_faces(triangles), pose, sensor)
    assert np.isfinite(depth).any()
    for other in (triangles[:, ::-1], np.concatenate([triangles, triangles[:, [1, 2, 0]]]), triangles[::-1]):
        changed = trace(box_faces(other), pose, sensor)
        assert (np.isfinite(changed) == np.isfinite(depth)).all()
        met = np.isfinite(depth)
        assert np.abs(changed[met] - depth[met]).max() <= 1e-7


def test_thousands_of_faces_on_top_of_each_other_in_bounded_memory() -> None:
    layers = np.concatenate([sheet(z) for z in np.random.default_rng(8).permutation(np.linspace(0.004, 0.04, 1500))])
    tracemalloc.start()
    depth = ray_depth(box_faces(layers), np.eye(4), SENSOR)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.abs(depth - 0.004).max() <= 1e-12
    assert peak < 300e6


@tracers
def test_faces_without_area_change_nothing(trace: Tracer) -> None:
    x, y = pixel_centres(SENSOR)
    spot = np.array([x[30], y[40], 0.002])
    across = spot + np.array([[-0.01, 0, 0], [0, 0, 0], [0.02, 0, 0]])
    upright = spot + np.array([[0, 0, 0], [0, 0, 0.001], [0, 0, 0.002]])
    flat = np.stack([np.tile(spot, (3, 1)), upright, across + np.array([0, 1e-5, 0])])
    depth = trace(box_faces(np.concatenate([sheet(0.006), flat])), np.eye(4), SENSOR)
    assert np.abs(depth - 0.006).max() <= 1e-7


@tracers
def test_open_mesh_is_seen_from_inside(trace: Tracer) -> None:
    bowl = ball(3, 0.02, z=0.003)
    bowl = bowl[(bowl[..., 2] > 0.003).all(axis=1)]
    depth = trace(box_faces(bowl), np.eye(4), SENSOR)
    assert abs(depth[50, 50] - 0.023) <= 1e-4


@tracers
def test_no_ray_slips_through_edges_and_corners(trace: Tracer) -> None:
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


def test_closed_fan_seen_through_its_hub() -> None:
    """Many faces meet at a corner that a ray hits: in any attitude, some face must take it."""
    rng = np.random.default_rng(6)
    sensor = coarse(3)  # its middle ray starts at the origin of the sensor's frame
    for _ in range(200):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 9)) * 0.5 + np.linspace(0, np.pi, 9, endpoint=False)
        rim = np.stack([np.cos(angle), np.sin(angle), rng.normal(size=9) * 0.3], axis=1) * 0.05
        fan = np.stack([np.zeros((9, 3)), rim, np.roll(rim, -1, axis=0)], axis=1) + np.array([0, 0, 0.006])
        pose = pose_at(np.array([0, 0, 0.006]), np.array([0, 0, 1.0]), 0.006, rng.uniform(0, 6))
        assert abs(ray_depth(box_faces(fan), pose, sensor)[1, 1] - 0.006) <= 1e-9


def test_only_what_is_seen_is_touched_and_nothing_seen_is_culled() -> None:
    triangles = ball(6, 0.25)
    faces = box_faces(triangles)
    pose = pose_at(np.array([0.25, 0, 0]), np.array([-1.0, 0, 0]), 0.005)
    seen = cull_faces(faces, pose, SENSOR)
    assert 0 < seen.shape[2] < 0.01 * len(triangles)
    away = pose_at(np.array([0.25, 0, 0]), np.array([1.0, 0, 0]), -0.001)
    assert cull_faces(faces, away, SENSOR).shape == (3, 3, 0)
    truth = brute_force(triangles, ray_origins(pose, coarse(6)), pose[:3, 2], SENSOR.range)
    assert np.abs(ray_depth(faces, pose, coarse(6)) - truth.depth).max() <= 1e-8


def test_sphere_tracing_says_which_rays_it_left_unsettled() -> None:
    wall = box((0.04, 0.04, 0.02), x=0.02 + 1e-5, z=0.015)
    local = cull_faces(box_faces(wall), np.eye(4), SENSOR)
    depth, settled = trace_spheres(local, SENSOR, 1e-7, 30)
    assert not settled.all()
    assert settled.mean() > 0.9
    exact = ray_depth(box_faces(wall), np.eye(4), SENSOR)
    assert (np.isfinite(depth) == np.isfinite(exact))[settled].all()


@pytest.mark.parametrize(
    ("triangles", "message"),
    [(np.zeros((4, 3)), r"shape \(4, 3\)"), (np.full((1, 3, 3), np.nan), "NaN")],
)
def test_bad_triangles_are_named(triangles: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        box_faces(triangles)


def test_bad_poses_and_tolerances_are_named() -> None:
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
