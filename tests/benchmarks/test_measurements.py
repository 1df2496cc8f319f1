"""The measurements: rasterisers, the judge of hidden places, formats, tables, peers that do not run."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from benchmarks import store
from benchmarks.depth import embree_depth, rasterised_depth
from benchmarks.surfaces import sees_outside
from benchmarks.timing import Table, Times, over_items, side_by_side
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.sensor import pixel_centres
from schemas.touch import TOUCH
from stages.render_vision.renderer import OpenGLContext

SENSOR = load_sensor("gel_16mm")
SHAPE = {name: (4, 100, 100, 3)[: len(TOUCH.arrays[name].dims) - 2] for name in store.MAPS}
"""Of one grasp, by array."""
NEAREST, SLOPE = 0.004, 0.3
"""The plane z = NEAREST + SLOPE · x, m, sensor frame."""


@pytest.fixture
def plane() -> Mesh:
    corners = np.array([[x, y, NEAREST + SLOPE * x] for x, y in 0.012 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])])
    return Mesh.bare(corners, np.array([[0, 2, 1], [0, 3, 2]]))  # wound to face the sensor


@pytest.mark.parametrize("eye", [0.0225, None])
def test_error_of_rasterised_depth_equals_its_closed_form(plane: Mesh, eye: float | None) -> None:
    """A pixel's ray x = u · Z meets the plane at the distance Z from the eye where Z - (eye - w) = NEAREST + SLOPE · u · Z."""
    context = OpenGLContext(SENSOR.cols)
    depth = rasterised_depth(context, plane, SENSOR, eye)(np.eye(4))
    context.close()
    x, _ = pixel_centres(SENSOR)
    expected = NEAREST + SLOPE * x
    if eye is not None:
        behind = eye - SENSOR.w
        expected = (NEAREST + behind) / (1 - SLOPE * x / eye) - behind
    half_pixel = SLOPE * SENSOR.width / SENSOR.cols / 2  # multisampling takes a depth so far aside
    np.testing.assert_allclose(depth, np.broadcast_to(expected, SENSOR.shape), rtol=0, atol=1.2 * half_pixel)


def test_embree_traces_a_tilted_plane(plane: Mesh) -> None:
    x, _ = pixel_centres(SENSOR)
    expected = np.broadcast_to(NEAREST + SLOPE * x, SENSOR.shape)
    np.testing.assert_allclose(embree_depth(plane.triangles, SENSOR)(np.eye(4)), expected, rtol=0, atol=1e-7)


def test_inner_box_is_hidden_from_outside() -> None:
    outer, inner = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.5, 0.5, 0.5))
    both = trimesh.util.concatenate(outer, inner)
    mesh = Mesh.bare(both.vertices, both.faces)
    centres = mesh.triangles.mean(axis=1)
    outside = sees_outside(mesh, centres, np.arange(len(centres)))
    np.testing.assert_array_equal(outside, np.repeat([True, False], 12))


def test_every_format_returns_the_shard_and_is_counted() -> None:
    rng = np.random.default_rng(0)
    arrays = {name: rng.integers(0, 9, (2, 1, *SHAPE[name])).astype(TOUCH.arrays[name].dtype) for name in store.MAPS}
    arrays["ok"] = np.array([True, False])
    table = Table("t", [f"column {number}" for number in range(8)])
    store.compare(table, store.formats(table), arrays, turns=1)
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows[".npy, one file per array"][2] == "3"
    raw = sum(array.nbytes for array in arrays.values())
    assert raw / 2 < float(rows[".npy, one file per array"][0].replace(",", "")) < raw / 2 + 1000
    assert float(rows[store.OURS][1]) == 1


def test_lossy_format_is_refused() -> None:
    arrays = {name: np.zeros((1, 1, *SHAPE[name]), np.float32) for name in store.MAPS}

    def write(folder: Path, arrays: dict[str, np.ndarray]) -> None:
        np.savez(folder / "a.npz", **{name: array + np.float32(1e-30) for name, array in arrays.items()})

    table = Table("t", [f"column {number}" for number in range(8)])
    with pytest.raises(ValueError, match=store.MAPS[0]):
        store.compare(table, {store.OURS: (write, lambda folder: np.load(folder / "a.npz"))}, arrays, turns=1)


def test_table_refuses_wrong_row_width_and_names_peers_that_could_not_run() -> None:
    table = Table("Title", ["ms", "÷"], ["a caption"])
    table.add("ours", "1", 1.5)
    with table.peer("peer"):
        raise RuntimeError("no g++ | here\nat all")
    with table.peer("other"):
        import a_package_that_nobody_has  # noqa: F401
    with pytest.raises(ValueError, match=r"1 cells.*2 columns, ms, ÷"):
        table.add("theirs", "1")
    text = table.markdown("`command` · commit")
    assert "| peer | could not run: no g++ / here at all | – |" in text
    assert "`make bench-peers` installs it | – |" in text
    assert [line.partition(":")[0] for line in table.missing] == ["peer", "other"]
    assert text.index("`command` · commit") < text.index("| ours | 1 | 1.5 |") < text.index("- a caption")


def test_times_are_measured_in_turns_after_warming_up() -> None:
    order: list[str] = []
    values = iter([9.0, 9.0, 1.0, 5.0, 3.0, 5.0, 2.0, 8.0])

    def once(name: str) -> float:
        order.append(name)
        return next(values)

    times = side_by_side({"a": lambda: once("a"), "b": lambda: once("b")}, 3)
    assert order == ["a", "b"] * 4
    assert times == {"a": Times(1.0, 2.0), "b": Times(5.0, 5.0)}
    assert over_items(lambda n: sum(range(n)), [200_000, 200_000])() > 0
