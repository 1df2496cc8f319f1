"""Reconstructions from nothing felt, twenty touches and views that are none; mesh files of any size anywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from pipeline.errors import StageError
from pipeline.inference.mesh_files import joined, write_charts, write_joined
from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.charts.chart_square import chart_square
from pipeline.kernels.charts.fit_rule import StopRule
from pipeline.kernels.metrics.distances import distances
from pipeline.models.reconstruct import Reconstruction, Reconstructor, View
from tests.learning import spheres

SPHERE = chart_sphere(0)
SIZE = spheres.SIDE**2


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Reconstructor]:
    data = tmp_path_factory.mktemp("models")
    return {name: Reconstructor(spheres.make_model(data, name)) for name in ("touch", "unoccluded")}


def felt(count: int, touched: bool = True) -> View:
    charts = np.random.default_rng(0).uniform(-0.1, 0.1, (count, SIZE, 3)).astype(np.float32) + np.float32([0, 0, 0.6])
    return View(None, charts, np.full(count, touched))


@pytest.mark.parametrize(("count", "touched"), [(0, True), (1, True), (20, True), (20, False)])
def test_a_surface_has_the_charts_of_all_touches_and_of_no_failed_one(models: dict[str, Reconstructor], count: int, touched: bool) -> None:
    found = models["touch"].reconstruct([felt(count, touched), felt(0)])
    assert [len(made.vertices) for made in found] == [len(SPHERE.vertices) + count * touched * SIZE, len(SPHERE.vertices)]
    assert all(np.isfinite(made.vertices).all() for made in found)
    assert found[0].faces.max() == len(found[0].vertices) - 1


def test_charts_without_a_fit_are_given_as_touches_that_failed() -> None:
    """Whatever ended a fit is a surface; the square of a sensor that met nothing is none."""
    rules = np.array([list(StopRule)])  # one grasp of a hand with that many sensors
    view = View.felt(None, np.zeros((*rules.shape, SIZE, 3), np.float32), rules)
    assert dict(zip(StopRule, view.touched.tolist(), strict=True)) == {
        StopRule.no_touch: False,
        StopRule.threshold: True,
        StopRule.cap: True,
        StopRule.too_few_points: False,
        StopRule.collapsed: False,
    }


def test_views_that_are_none_are_refused(models: dict[str, Reconstructor]) -> None:
    nowhere = felt(2)
    nowhere.touch_vertices[1, 3, 0] = np.nan
    image = np.zeros((1, 1, 3), np.uint8)
    size = spheres.CAMERA.resolution
    for name, views, message in (
        ("touch", [], "touch: there is no view"),
        ("touch", [nowhere], "touch: touch_vertices has values that are not finite"),
        ("unoccluded", [View.unfelt(image)], r"unoccluded: it was trained on images of .* these have \[1, 1\]"),
        ("unoccluded", [View.unfelt(np.zeros((size, size, 3), np.float32))], r"unoccluded: images are .* torch.float32; stored images are"),
    ):
        with pytest.raises(StageError, match=message):
            models[name].reconstruct(views)


@pytest.mark.parametrize("value", [0, 255])
def test_a_black_or_white_view_still_gives_a_surface(models: dict[str, Reconstructor], value: int) -> None:
    size = spheres.CAMERA.resolution
    (made,) = models["unoccluded"].reconstruct([View.unfelt(np.full((size, size, 3), value, np.uint8))])
    assert np.isfinite(made.vertices).all()


def surface(scale: float, offset: float, touches: int = 1) -> Reconstruction:
    """The sphere, and so many triangles' worth of squares, in one place."""
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
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (0.25, 0.6), (1e3, 0.0), (0.25, 1e3)])
def test_files_are_as_exact_as_the_docstring_says(tmp_path: Path, suffix: str, scale: float, offset: float) -> None:
    """OBJ to half of its eighth decimal along each axis, PLY and GLB to the rounding of float32."""
    made = surface(scale, offset)
    bound = 1.01 * np.sqrt(3) * (5e-9 if suffix == ".obj" else 6e-8 * np.abs(made.vertices).max())
    write_charts(tmp_path / f"apart{suffix}", made)
    write_joined(tmp_path / f"joined{suffix}", made)
    for name, vertices in (("apart", made.vertices), ("joined", np.concatenate([joined(made)[0], made.vertices[made.vision :]]))):
        found = distances(read(tmp_path / f"{name}{suffix}"), vertices)  # programs may read parts in another order
        assert len(found.predicted) == len(found.truth)
        assert max(found.predicted.max(), found.truth.max()) <= bound**2


def test_vertices_that_coincided_and_still_do_are_joined_where_they_are() -> None:
    made = surface(1.0, 1e3, touches=0)
    vertices, faces = joined(made)
    np.testing.assert_allclose(vertices[SPHERE.position], made.vertices, rtol=1e-15, atol=0)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("vertex", [0, -1])
def test_no_file_is_written_of_vertices_that_are_nowhere(tmp_path: Path, vertex: int, value: float) -> None:
    made = surface(1.0, 0.0)
    made.vertices[vertex, 1] = value
    for write in (write_charts, write_joined):
        with pytest.raises(StageError, match=r"1 of \d+ vertices hold NaN or infinity"):
            write(tmp_path / "mesh.obj", made)
    assert not list(tmp_path.iterdir())


def test_torch_is_left_as_it_was(models: dict[str, Reconstructor]) -> None:
    before = torch.random.get_rng_state()
    models["touch"].reconstruct([felt(1)])
    assert torch.equal(torch.random.get_rng_state(), before)
