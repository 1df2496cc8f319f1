"""Mesh files of reconstructions: accuracy, joined charts, and what is not written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import StageError
from pipeline.inference.mesh_files import write_charts, write_joined
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.models.reconstruction import Reconstruction, join_vision_charts
from tests.stages import ball_dataset as spheres

SPHERE = vision_charts(0)
SIZE = spheres.SIDE**2


def surface(scale: float, offset: float, touches: int = 1) -> Reconstruction:
    """Make the sphere with touch charts at random, scaled and moved."""
    _, square = chart_square(spheres.SIDE)
    rng = np.random.default_rng(0)
    vertices = np.concatenate([SPHERE.vertices, rng.uniform(-1, 1, (touches * SIZE, 3))]) * scale + offset
    first = len(SPHERE.vertices) + SIZE * np.arange(touches)
    faces = np.concatenate([SPHERE.faces, (square.numpy()[None] + first[:, None, None]).reshape(-1, 3)])
    return Reconstruction(vertices, faces, len(SPHERE.vertices), SPHERE.position, spheres.SIDE)


def read(path: Path) -> np.ndarray:
    whole = trimesh.load_scene(path, process=False).to_mesh().vertices
    return whole[:, [0, 2, 1]] * [1, -1, 1] if path.suffix == ".glb" else whole


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (0.25, 0.6), (10.0, 0.0), (0.25, 10.0)])
def test_mesh_files_err_as_documented(tmp_path: Path, suffix: str, scale: float, offset: float) -> None:
    """OBJ to half of its eighth decimal along each axis, PLY and GLB to the rounding of float32."""
    made = surface(scale, offset)
    bound = 1.01 * np.sqrt(3) * (5e-9 if suffix == ".obj" else 6e-8 * np.abs(made.vertices).max())
    write_charts(tmp_path / f"apart{suffix}", made)
    write_joined(tmp_path / f"joined{suffix}", made)
    for name, vertices in (
        ("apart", made.vertices),
        ("joined", np.concatenate([join_vision_charts(made)[0], made.vertices[made.vision :]])),
    ):
        found = cloud_distances(read(tmp_path / f"{name}{suffix}"), vertices)  # programs may read parts in another order
        assert len(found.predicted) == len(found.truth)
        assert max(found.predicted.max(), found.truth.max()) <= bound**2


def test_coinciding_vertices_are_joined_where_they_are() -> None:
    made = surface(1.0, 10.0, touches=0)
    vertices, faces = join_vision_charts(made)
    np.testing.assert_allclose(vertices[SPHERE.position], made.vertices, rtol=1e-15, atol=0)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("vertex", [0, -1])
def test_vertices_that_are_not_finite_are_not_written(tmp_path: Path, vertex: int, value: float) -> None:
    made = surface(1.0, 0.0)
    made.vertices[vertex, 1] = value
    for write in (write_charts, write_joined):
        with pytest.raises(StageError, match=r"1 of \d+ vertices hold NaN or infinity"):
            write(tmp_path / "mesh.obj", made)
    assert not list(tmp_path.iterdir())
