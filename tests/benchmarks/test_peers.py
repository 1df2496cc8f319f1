"""The comparison with peers: rasterisers, references, the judge of hidden places, formats, tables."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from benchmarks.embree import EmbreeDepth
from benchmarks.peers import store
from benchmarks.peers.depth import brute_force_depth
from benchmarks.peers.rasterisers import ParallelRasteriser, PerspectiveRasteriser
from benchmarks.peers.surfaces import sees_outside
from benchmarks.peers.table import Table
from benchmarks.peers.taxim_shim import scatter_min
from benchmarks.peers.worker import PeerError, Worker
from benchmarks.timing import Times, each, side_by_side, three_digits
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.sensor import pixel_centres, ray_origins
from stages.render_vision.opengl_context import OpenGLContext

SENSOR = load_sensor("gel_16mm")
NEAREST, SLOPE = 0.004, 0.3
"""The plane z = NEAREST + SLOPE · x, m, sensor frame."""


@pytest.fixture
def plane() -> Mesh:
    corners = np.array([[x, y, NEAREST + SLOPE * x] for x, y in 0.012 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])])
    return Mesh.bare(corners, np.array([[0, 2, 1], [0, 3, 2]]))  # wound to face the sensor


def test_parallel_rasteriser_shows_a_tilted_plane(plane: Mesh) -> None:
    context = OpenGLContext(SENSOR.cols)
    depth = ParallelRasteriser(context, plane, SENSOR).depth(np.eye(4))
    context.close()
    x, _ = pixel_centres(SENSOR)
    np.testing.assert_allclose(depth, np.broadcast_to(NEAREST + SLOPE * x, SENSOR.shape), rtol=0, atol=1e-7)


@pytest.mark.parametrize("eye", [0.0225, 1.0])
def test_perspective_rasteriser_errs_as_its_closed_form(plane: Mesh, eye: float) -> None:
    """A pixel's ray x = u · Z meets the plane at the distance Z from the eye where Z - (eye - w) = NEAREST + SLOPE · u · Z."""
    context = OpenGLContext(SENSOR.cols)
    rasteriser = PerspectiveRasteriser(context, plane, SENSOR, eye)
    depth = rasteriser.depth(np.eye(4))
    context.close()
    x, _ = pixel_centres(SENSOR)
    behind = eye - SENSOR.w
    expected = (NEAREST + behind) / (1 - SLOPE * x / eye) - behind
    half_pixel = SLOPE * SENSOR.width / SENSOR.cols / 2  # multisampling takes a depth so far aside
    np.testing.assert_allclose(depth, np.broadcast_to(expected, SENSOR.shape), rtol=0, atol=1.2 * half_pixel)
    wrong = np.abs(depth - (NEAREST + SLOPE * x)).max()
    assert wrong > 1e-4 if eye < 0.1 else wrong < 5e-5


def test_embree_and_brute_force_show_a_tilted_plane(plane: Mesh) -> None:
    x, _ = pixel_centres(SENSOR)
    expected = np.broadcast_to(NEAREST + SLOPE * x, SENSOR.shape)
    np.testing.assert_allclose(EmbreeDepth(plane.triangles, SENSOR).depth(np.eye(4)), expected, rtol=0, atol=1e-7)
    origins = ray_origins(np.eye(4), SENSOR)[::10, ::10]
    depth, doubtful = brute_force_depth(plane.triangles, origins, np.array([0.0, 0, 1]), SENSOR.range)
    np.testing.assert_allclose(depth[~doubtful], expected[::10, ::10][~doubtful], rtol=0, atol=1e-12)
    assert doubtful.sum() <= len(doubtful)  # on the diagonal that two faces share
    assert np.isinf(brute_force_depth(plane.triangles, origins + [0, 0, 1], np.array([0.0, 0, 1]), SENSOR.range)[0]).all()


def test_inner_box_is_hidden_from_outside() -> None:
    outer, inner = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.5, 0.5, 0.5))
    both = trimesh.util.concatenate(outer, inner)
    mesh = Mesh.bare(both.vertices, both.faces)
    centres = mesh.triangles.mean(axis=1)
    outside = sees_outside(mesh, centres, np.arange(len(centres)))
    np.testing.assert_array_equal(outside, np.repeat([True, False], 12))


def test_every_format_returns_the_shard_and_is_counted() -> None:
    rng = np.random.default_rng(0)
    depth = rng.random((2, 1, 4, 100, 100), dtype=np.float32)
    depth[depth > 0.5] = np.inf
    arrays = {"depth": depth, "reading": rng.integers(0, 255, (2, 1, 4, 100, 100, 3), dtype=np.uint8), "ok": np.array([True, False])}
    table = Table("t", ["bytes a grasp", "÷ ours", "files", "write", "÷", "read", "÷", "one"], [])
    formats = {
        store.OURS: store.Format(store._write_zarr, store._read_zarr, store._grasp_zarr),
        ".npy": store.Format(store._write_npy, store._read_npy, store._grasp_npy),
        "small": store.Format(store._write_small, store._read_small, store._grasp_small),
    }
    store.compare(table, formats, arrays, turns=1, grasps=2)
    by_name = {row[0]: row[1:] for row in table.rows}
    assert [by_name[name][2] for name in (".npy", "small")] == ["3", "5"]
    raw = sum(array.nbytes for array in arrays.values())
    assert raw / 2 < float(by_name[".npy"][0].replace(",", "")) < raw / 2 + 1000


def test_a_format_that_loses_a_bit_is_refused(tmp_path: Path) -> None:
    arrays = {name: np.zeros((1, 1, 4, 100, 100), np.float32) for name in store.MAPS}

    def forgetful(folder: Path) -> dict[str, np.ndarray]:
        return {name: array + np.float32(1e-30) for name, array in store._read_npy(folder).items()}

    table = Table("t", ["bytes a grasp", "÷ ours", "files", "write", "÷", "read", "÷", "one"], [])
    with pytest.raises(ValueError, match="depth"):
        store.compare(table, {store.OURS: store.Format(store._write_npy, forgetful, store._grasp_npy)}, arrays, turns=1, grasps=1)


def test_scatter_min_replacement_takes_the_least_per_index() -> None:
    source, out = torch.tensor([[5.0, 1.0, 3.0]]), torch.full((1, 3), torch.inf)
    least, _ = scatter_min(source, torch.tensor([2, 0, 2]), dim_size=3, out=out)
    assert least.tolist() == [[1.0, torch.inf, 3.0]]


def test_table_refuses_wrong_row_width_and_names_peers_that_could_not_run() -> None:
    table = Table("Title", ["ms", "÷"], ["a caption"])
    table.add("ours", "1", "1.00")
    table.could_not_run("peer", "no g++ | here\nat all")
    with pytest.raises(ValueError, match=r"1 cells.*2 columns, ms, ÷"):
        table.add("theirs", "1")
    text = table.markdown("`command` · commit")
    assert "| peer | could not run: no g++ / here at all | – |" in text
    assert text.index("`command` · commit") < text.index("| ours |") < text.index("- a caption")


def test_worker_reports_why_it_ended(tmp_path: Path) -> None:
    with pytest.raises(PeerError, match=r"status 1: .*No module named benchmarks\.nowhere"):
        Worker(Path(sys.executable), "benchmarks.nowhere", [], tmp_path / "log")
    with pytest.raises(PeerError, match="missing; `make bench-peers`"):
        Worker(tmp_path / "python", "benchmarks.nowhere", [], tmp_path / "log")


def test_times_are_taken_in_turns_after_warming_up() -> None:
    order: list[str] = []
    values = iter([9.0, 9.0, 1.0, 5.0, 3.0, 5.0, 2.0, 8.0])

    def once(name: str) -> float:
        order.append(name)
        return next(values)

    times = side_by_side({"a": lambda: once("a"), "b": lambda: once("b")}, 3)
    assert order == ["a", "b"] * 4
    assert times == {"a": Times(1.0, 2.0), "b": Times(5.0, 5.0)}
    assert each(lambda n: sum(range(n)), [200_000, 200_000])() > 0


@pytest.mark.parametrize(
    ("value", "text"), [(0.012345, "0.0123"), (1.2345, "1.23"), (12.34, "12.3"), (1234.5, "1230"), (0.0, "0"), (1.2e-5, "1e-05")]
)
def test_three_digits(value: float, text: str) -> None:
    assert three_digits(value) == text
