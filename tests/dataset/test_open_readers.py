"""Open readers of replaced and collected groups get a clear error and never zeros."""

import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.config.settings import Settings
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset

ARRAYS = ("untouched", "sensor_pose", "touch_success", "tactile_image", "depth")
AGAIN = "it was replaced since it was opened: open the dataset again, or run the same command again"


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, 4, shards=2)
    for name in ("vision", "charts", "distances"):
        shutil.rmtree(folder / name)
    return folder


@pytest.fixture
def data(original, tmp_path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "data"))


def replace(data: Path) -> None:
    """Run the stages with another seed; the rows stay equal, so that all artifacts match."""
    for stage in (stage for stage in ball_dataset.stages() if stage.output in (SURFACES, GRASPS, TOUCH)):
        wanted: Any = Request(
            stage=stage, settings=Settings(), manifest="balls", objects=ball_dataset.objects(4), preset="draft", seed=1, data=data
        )
        pack(wanted, stage.row)
    collect_everything(DataDirectory(data), older_than=-1)


def test_reading_rows_of_a_replaced_group_names_object_file_and_remedy(data):
    rows, dataset = ObjectRows(data, ARRAYS, None, cache_megabytes=0), GraspDataset(data, ARRAYS, None)
    first = dataset[0]
    for name in ARRAYS:
        rows.read(name, "a", 1)
    replace(data)
    for name in ARRAYS:
        with pytest.raises(StoreError, match=AGAIN) as error:
            rows.read(name, "b", 1)
        assert str(DataDirectory(data).root) in str(error.value)
    with pytest.raises(StoreError, match=rf"touch/000.-of-0002-\w+\.zarr: depth of b cannot be read .*does not exist.*{AGAIN}"):
        rows.read("depth", "b", 1)
    with pytest.raises(StoreError, match=AGAIN):
        dataset[len(dataset) - 1]
    reopened = GraspDataset(data, ARRAYS, None)
    np.testing.assert_array_equal(reopened[0]["depth"], first["depth"])
    assert (reopened[len(reopened) - 1]["depth"] > 0).all()


def test_reading_a_mesh_of_a_replaced_group_is_an_error(data):
    view = DataDirectory(data).collection(SURFACES).view("b")
    vertices = view["meshes/vertices"]
    assert vertices.any()
    replace(data)
    assert view["meshes/vertices"] is vertices, "kept since it was read"
    for name in ("points", "meshes/uv", "meshes/faces"):
        with pytest.raises(StoreError, match=AGAIN):
            view[name]


def test_loading_an_open_xarray_of_a_replaced_group_is_an_error(data):
    touch = open_artifact(data, "touch")
    assert float(touch.depth.sel(object="a").min()) > 0
    replace(data)
    selections = (
        lambda: touch.depth.sel(object=["b", "c"]),
        lambda: touch.depth[1, 2, 3],
        lambda: touch.tactile_image.isel(grasp=1),
        lambda: touch,
    )
    for read in selections:
        with pytest.raises(StoreError, match=AGAIN):
            read().load()
    assert float(open_artifact(data, "touch").depth.min()) > 0


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(("harm", "reason"), [(damage, "cannot be read"), (Path.unlink, "the chunk is missing: 'depth/c/0/0/0/0/0'")])
def test_a_damaged_or_missing_chunk_is_named_when_xarray_reads_it(data, harm: Callable[[Path], None], reason: str):
    touch, group = open_artifact(data, "touch"), DataDirectory(data).collection(TOUCH).shard("b").path
    (chunk,) = (path for path in (group / "depth" / "c").rglob("*") if path.is_file())
    harm(chunk)
    with pytest.raises(StoreError, match=rf"{group}: depth.*{reason}.*give-touch --check"):
        touch.depth.load()
    assert touch.tactile_image.any(), "what is sound is read"


def test_xarray_selections_equal_the_rows(data):
    touch, rows = pickle.loads(pickle.dumps(open_artifact(data, "touch"))), ObjectRows(data, ["depth"], None)
    whole = np.stack([rows.read("depth", name) for name in "abcd"])
    np.testing.assert_array_equal(touch.depth[[3, 0], ::-2, [2, 1]], whole[[3, 0]][:, ::-2][:, :, [2, 1]])
    np.testing.assert_array_equal(touch.depth.isel(object=-1, row=slice(5, 1, -1)), whole[-1, :, :, 5:1:-1])
    assert touch.sel(object=["d", "b"]).depth.equals(touch.depth.sel(object=["d", "b"]))
    assert [*touch.depth.encoding["preferred_chunks"].values()] == [1, 1, 4, 100, 100]


def test_row_view_contains_only_the_written_arrays(data):
    view = DataDirectory(data).collection(SURFACES).view("a")
    assert "meshes/vertex_color" not in view
    assert "placement" in view
    assert "meshes/faces" in view
