"""Both tracers against all rays x all faces in float64, on real meshes."""

import numpy as np
import pytest

from pipeline.kernels.touch.ray_depth import TOLERANCE, box_faces, ray_depth, sphere_traced_depth
from pipeline.kernels.touch.sensor import Sensor
from tests.kernels.touch.shapes import SENSOR, TWENTY, coarse, pybullet_triangles, random_pose, ray_origins
from tests.references.brute_force_depth import brute_force

EXACT = 1e-8
"""m: what is promised of `ray`."""


GRAZING = 0.1
"""|cos| below which a pixel is reported apart: the face stands within 6 degrees of the ray."""


def errors(triangles: np.ndarray, pose: np.ndarray, sensor: Sensor) -> dict[str, np.ndarray]:
    """|depth error| of both tracers in m, and the rays float64 leaves open; asserts no other is lost, false or off."""
    truth = brute_force(triangles, ray_origins(pose, sensor), pose[:3, 2], sensor.range)
    sure = ~truth.doubtful
    faces = box_faces(triangles)
    result = {}
    for name, trace, limit in (("ray", ray_depth, EXACT), ("sphere", sphere_traced_depth, 2 * TOLERANCE)):
        depth = trace(faces, pose, sensor)
        assert depth.shape == sensor.shape
        assert depth.dtype == np.float64
        lost = np.isinf(depth) & np.isfinite(truth.depth) & sure
        false = np.isfinite(depth) & np.isinf(truth.depth) & sure
        assert not lost.any(), f"{name} lost {lost.sum()} hits"
        assert not false.any(), f"{name} has {false.sum()} false hits"
        for kind, pixels in (("", truth.cosine >= GRAZING), (", grazing", truth.cosine < GRAZING)):
            met = pixels & sure & np.isfinite(depth)
            result[name + kind] = np.abs(depth[met] - truth.depth[met])
            assert result[name + kind].max(initial=0) <= limit
    result["doubtful"] = truth.doubtful[truth.doubtful]
    return result


@pytest.mark.parametrize("name", ["duck.obj", "objects/mug.obj", "random_urdfs/126/126.obj"])
def test_depth_of_real_meshes(name: str) -> None:
    triangles = pybullet_triangles(name)
    rng = np.random.default_rng(1)
    for _ in range(3):
        errors(triangles, random_pose(triangles, rng), coarse(24))


@pytest.mark.slow
def test_depth_of_twenty_real_meshes_at_full_size() -> None:
    gathered: dict[str, list[np.ndarray]] = {}
    rng = np.random.default_rng(2)
    for name in TWENTY:
        triangles = pybullet_triangles(name)
        for tilt in (0.3, 1.0):
            for key, value in errors(triangles, random_pose(triangles, rng, tilt), SENSOR).items():
                gathered.setdefault(key, []).append(value)
    for key, parts in gathered.items():
        values = np.concatenate(parts)
        shown = np.percentile(values * 1e6, [50, 90, 99, 99.9, 100]).tolist() if len(values) else []
        print(f"{key}: {len(values)} rays, |error| in µm at 50 90 99 99.9 100 %:", *(f"{value:.1e}" for value in shown))


def test_depth_of_random_faces_with_slivers_and_edge_on_faces() -> None:
    rng = np.random.default_rng(3)
    corner = rng.uniform([-0.01, -0.01, -0.005], [0.01, 0.01, 0.06], (300, 3))
    spread = rng.normal(size=(300, 2, 3)) * rng.choice([1e-6, 1e-4, 1e-2], (300, 1, 1))
    spread[::3, 1] = spread[::3, 0] * 0.5 + rng.normal(size=(100, 3)) * 1e-7  # slivers
    spread[1::3, 0] = [0, 0, 0.02]  # edge-on to an untilted sensor
    triangles = corner[:, None] + np.concatenate([np.zeros((300, 1, 3)), spread], axis=1)
    errors(triangles, np.eye(4), coarse(40))
    for _ in range(4):
        errors(triangles, random_pose(triangles, rng), coarse(40))
