"""Artifacts in xarray: plain, through `open_artifact`, and copied to Zarr and netCDF."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray

from pipeline.config.settings import Settings
from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.plan import Request
from pipeline.store.directory import DataDirectory
from pipeline.store.validate import problems_of
from schemas.touch import TOUCH
from tests.engine.tiny_stages import pack
from tests.stages import ball_dataset

OBJECTS = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("balls")
    ball_dataset.make_data(folder, len(OBJECTS))
    return folder


@pytest.fixture(scope="module")
def split(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("split") / "data"
    ball_dataset.make_data(folder, len(OBJECTS), shards=3)
    return folder


@pytest.fixture(params=["whole", "split"])
def data(request: pytest.FixtureRequest) -> Path:
    folder: Path = request.getfixturevalue(request.param)
    return folder


def test_plain_xarray_selects_objects_by_name_and_reads_pixels_of_the_shape(whole: Path) -> None:
    touch = xarray.open_zarr(DataDirectory(whole).collection(TOUCH).first.path, consolidated=False)
    rows = ObjectRows(whole, ["tactile_image"], None)
    assert touch.object.values.tolist() == touch.object_id.values.tolist() == list(OBJECTS)
    np.testing.assert_array_equal(touch.tactile_image.sel(object="c", grasp=1), rows.read("tactile_image", "c", 1))


def test_plain_xarray_copies_a_subset_of_a_shard(whole: Path, tmp_path: Path) -> None:
    touch = xarray.open_zarr(DataDirectory(whole).collection(TOUCH).first.path, consolidated=False)
    touch.isel(object=[0, 2]).to_zarr(tmp_path / "copy", consolidated=False, align_chunks=True)
    assert xarray.open_zarr(tmp_path / "copy", consolidated=False).equals(touch.isel(object=[0, 2]))


@pytest.mark.parametrize("artifact", ["surfaces", "grasps", "vision", "touch"])
def test_opened_artifact_copies_a_subset(data: Path, artifact: str, tmp_path: Path) -> None:
    subset = open_artifact(data, artifact).isel(object=[0, 2])
    subset.to_zarr(tmp_path / "copy", consolidated=False)
    copy = xarray.open_zarr(tmp_path / "copy", consolidated=False)
    assert copy.equals(subset)
    assert copy.attrs == subset.attrs


def test_opened_artifact_is_written_as_netcdf_with_nested_attributes_as_json(data: Path, tmp_path: Path) -> None:
    grasps = open_artifact(data, "grasps")
    grasps.to_netcdf(tmp_path / "grasps.nc")
    with xarray.open_dataset(tmp_path / "grasps.nc") as copy:
        assert copy.equals(grasps)
        assert copy.attrs == grasps.attrs
    assert json.loads(grasps.attrs["failures"]) == {}
    assert json.loads(grasps.attrs["settings"]) == {"hand": "allegro_right"}


@pytest.mark.parametrize("number", [0, 1], ids=["surfaces", "grasps"])
def test_shard_in_which_every_object_failed_has_every_required_array(tmp_path: Path, number: int) -> None:
    for stage in ball_dataset.stages()[: number + 1]:
        request = Request(stage, Settings(), "balls", ball_dataset.objects(2), "draft", 0, tmp_path)
        pack(request, stage.row, "ab" if stage.output.order == number else "")
    assert open_artifact(tmp_path, stage.output.name).ok.values.tolist() == [False, False]
    assert not problems_of(DataDirectory(tmp_path).collection(stage.output).first)
