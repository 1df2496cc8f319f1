"""Depth against exact intersection in fractions: slivers, walls, rays through corners and edges, any size, any place."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume

from pipeline.kernels.geometry.mesh import face_cross_products
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import RAY_TOLERANCE, local_depth, ray_depth
from pipeline.kernels.touch.sensor import Sensor, check_pose, pixel_centres, ray_origins
from pipeline.kernels.touch.sphere_tracing import TOLERANCE, sphere_traced_depth
from tests.extremes.profile import for_all
from tests.extremes.strategies import EPS, aspects, offsets, scales, seeds, sliver, turn
from tests.extremes.test_depth import tracers
from tests.touch.scenes import SENSOR, ball, coarse, pose_at

SMALL = coarse(6)
X, Y = pixel_centres(SMALL)
HEIGHTS = (0.001, 0.03)


def slivers(rng: np.random.Generator) -> np.ndarray:
    """A face 10^8 times as long as it is high, its middle on a ray."""
    face = 0.02 * sliver(1e8, rng)
    return face + [rng.choice(X), rng.choice(Y), 0.01] - face.mean(axis=0)


def walls(rng: np.random.Generator) -> np.ndarray:
    """A face all but parallel to the rays, that a ray hits."""
    across = turn(rng)[0, :2]
    spread = np.outer(rng.uniform(-0.005, 0.005, 3), across) + rng.normal(size=(3, 2)) * 1e-10
    return np.column_stack([[rng.choice(X), rng.choice(Y)] + spread - spread.mean(axis=0), rng.uniform(*HEIGHTS, 3)])


def cornered(rng: np.random.Generator) -> np.ndarray:
    """A face with corners and edges on rays."""
    return np.column_stack([rng.choice(X, 3), rng.choice(Y, 3), rng.uniform(*HEIGHTS, 3)])


def any_face(rng: np.random.Generator) -> np.ndarray:
    return np.column_stack([rng.uniform(-0.01, 0.01, (3, 2)), rng.uniform(*HEIGHTS, 3)])


def exact(face: np.ndarray, x: float, y: float) -> tuple[Fraction, Fraction, Fraction] | None:
    """Where a ray at (x, y) meets a face's plane, how far inside the rim (least barycentric weight), and the plane's slope."""
    a, b, c = ([Fraction(float(v)) for v in corner] for corner in face)
    u, v = Fraction(x), Fraction(y)

    def area(p: list[Fraction], q: list[Fraction]) -> Fraction:
        return (p[0] - u) * (q[1] - v) - (q[0] - u) * (p[1] - v)

    parts = area(b, c), area(c, a), area(a, b)
    whole = sum(parts, Fraction(0))
    if whole == 0:
        return None
    weights = [part / whole for part in parts]
    z = sum(w * corner[2] for w, corner in zip(weights, (a, b, c), strict=True))
    slope = max(abs((b[k] - a[k]) * (c[2] - a[2]) - (c[k] - a[k]) * (b[2] - a[2])) for k in (0, 1)) / abs(whole)
    return z, min(weights), slope


def height_of(face: np.ndarray) -> float:
    """Least height of a face seen along z, m: so much a weight of 1 is."""
    flat = face[:, :2]
    edges = np.linalg.norm(flat - np.roll(flat, 1, axis=0), axis=1)
    (ux, uy), (vx, vy) = flat[1] - flat[0], flat[2] - flat[0]
    return float(abs(ux * vy - uy * vx) / edges.max())


@pytest.mark.parametrize("make", [any_face, slivers, walls, cornered])
@for_all(few=15, many=600, seed=seeds)
def test_a_depth_is_that_of_a_ray_next_to_its_own(make, seed) -> None:
    face = make(np.random.default_rng(seed))
    depth = local_depth(np.ascontiguousarray(face.T[:, :, None]), SMALL)
    aside = RAY_TOLERANCE * SMALL.width
    for row, y in enumerate(Y):
        for col, x in enumerate(X):
            met = exact(face, float(x), float(y))
            if met is None:  # edge-on: not met itself, as the contract says, or its rim is
                continue
            z, inside, slope = met
            clear = float(inside) * height_of(face)  # m from the rim, where it is not doubtful
            if np.isfinite(depth[row, col]):
                assert clear >= -aside
                assert abs(float(Fraction(float(depth[row, col])) - z)) <= 2 * float(slope) * aside + EPS * SMALL.range
            else:
                assert clear <= aside


@for_all(few=10, many=300, seed=seeds, scale=scales)
def test_a_scene_of_another_size_has_depths_of_that_size(seed, scale) -> None:
    sensor = SMALL.model_copy(update={"width": SMALL.width * scale, "w": SMALL.w * scale, "range": SMALL.range * scale})
    triangles, pose = pressed_ball(np.random.default_rng(seed), np.zeros(3))
    scaled = pose.copy()
    scaled[:3, 3] *= scale
    here, there = ray_depth(box_faces(triangles), pose, SMALL), ray_depth(box_faces(triangles * scale), scaled, sensor)
    np.testing.assert_array_equal(np.isfinite(here), np.isfinite(there))
    met = np.isfinite(here)
    assert np.abs(there[met] / scale - here[met]).max() <= 1e-14
    marched = sphere_traced_depth(box_faces(triangles * scale), scaled, sensor, tolerance=TOLERANCE * scale)
    assert np.abs(marched[met] - there[met]).max() <= 1.01 * TOLERANCE * scale


@tracers
@for_all(few=10, many=300, seed=seeds, offset=offsets)
def test_a_scene_far_away_has_the_same_depths(trace, seed, offset) -> None:
    """But for what float64 leaves of a coordinate there: a tenth of a nanometre a kilometre from the origin."""
    rng = np.random.default_rng(seed)
    triangles, pose = pressed_ball(rng, np.zeros(3))
    moved = pose.copy()
    moved[:3, 3] += offset
    here, there = trace(box_faces(triangles), pose, SMALL), trace(box_faces(triangles + offset), moved, SMALL)
    sure = np.isfinite(here) & (here < SMALL.w)  # beyond, near the silhouette, a surface is too steep to compare
    allowed = 16 * EPS * np.abs(offset).max() + 1e-14 + (trace is sphere_traced_depth) * TOLERANCE
    assert np.isfinite(there[sure]).all()
    assert np.abs(there[sure] - here[sure]).max() <= allowed


def pressed_ball(rng: np.random.Generator, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A ball of 2 cm around `middle`, and a sensor pressed 2 mm onto it."""
    towards = turn(rng)[:, 2]
    return ball(3, 0.02) + middle, pose_at(middle - 0.02 * towards, towards, SENSOR.w - 0.002, rng.uniform(0, 6))


@tracers
@for_all(few=10, many=300, seed=seeds)
def test_inside_out_doubled_and_mixed_up_faces_change_nothing(trace, seed) -> None:
    rng = np.random.default_rng(seed)
    triangles, pose = pressed_ball(rng, np.array([0, 0, 0.6]))
    depth = trace(box_faces(triangles), pose, SMALL)
    doubled = np.concatenate([triangles, triangles[rng.random(len(triangles)) < 0.5]])
    doubled[rng.random(len(doubled)) < 0.5] = doubled[rng.random(len(doubled)) < 0.5][:1]  # one face, hundreds of times
    mixed = np.concatenate([triangles, rng.permutation(doubled)[:, rng.permutation(3)]])
    changed = trace(box_faces(mixed), pose, SMALL)
    np.testing.assert_array_equal(np.isfinite(changed), np.isfinite(depth))
    met = np.isfinite(depth)
    assert np.abs(changed[met] - depth[met]).max() <= (TOLERANCE if trace is sphere_traced_depth else 4 * EPS)


@tracers
@pytest.mark.parametrize("across", [False, True])
def test_rays_that_graze_a_plate_meet_its_nearest_point_or_nothing(trace, across) -> None:
    """It stands edge-on over the middle column, or row, of rays; with a lid on it, it is met in any case."""
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
@for_all(few=15, many=500, seed=seeds, aspect=aspects)
def test_no_sliver_alone_is_stepped_through(trace, seed, aspect) -> None:
    """Half a metre long, across the middle ray: a distance to it may be wrong, a depth may not."""
    rng = np.random.default_rng(seed)
    face = 0.5 * sliver(aspect, rng)
    normal = face_cross_products(face[None])[0]
    assume(abs(normal[2]) > 0.1 * np.linalg.norm(normal))  # a wall has other tests
    face += [0, 0, 0.01] - rng.dirichlet([3, 3, 3]) @ face
    assert trace(box_faces(face[None]), np.eye(4), coarse(3))[1, 1] == pytest.approx(0.01, abs=1.01 * TOLERANCE)


@for_all(few=20, many=500, seed=seeds, offset=offsets)
def test_origins_of_rays_lie_on_the_sensor_plane(seed, offset) -> None:
    pose = pose_at(offset, turn(np.random.default_rng(seed))[0], 0.01, seed % 6)
    local = (ray_origins(pose, SMALL) - pose[:3, 3]) @ pose[:3, :3]
    expected = np.stack(np.broadcast_arrays(X[None, :], Y[:, None], 0.0), axis=-1)
    assert np.abs(local - expected).max() <= 4 * EPS * (np.abs(offset).max() + 1)


@pytest.mark.parametrize("spoil", ["transposed", "projective"])
def test_poses_with_another_last_row_are_named(spoil) -> None:
    pose = pose_at(np.array([0.1, 0.2, 0.3]), np.array([0, 0, 1.0]), 0.01)
    bad = pose.T if spoil == "transposed" else pose + np.diag([0, 0, 0, 1.0])
    with pytest.raises(ValueError, match="last row"):
        check_pose(bad)


def test_a_sensor_of_the_fewest_pixels_and_of_unequal_sides() -> None:
    sensor: Sensor = SENSOR.model_copy(update={"rows": 2, "cols": 7})
    floor = np.array([[[-1, -1, 0.005], [3, -1, 0.005], [-1, 3, 0.005]]])
    assert ray_depth(box_faces(floor), np.eye(4), sensor).tolist() == [[0.005] * 7] * 2
