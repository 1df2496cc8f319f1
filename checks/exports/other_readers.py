"""Other readers of Zarr and netCDF read the stored numbers; `make test-exports` runs this file.

`docs/guide/reading.md` says the same as a table: where a test here fails because a reader learnt something, the table is out of date.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
import pytest
import tensorstore
import xarray
import zarr
import zarrs  # noqa: F401 (registers its pipeline)

from pipeline.dataset.labelled import open_artifact
from pipeline.store.directory import DataDirectory
from pipeline.store.shard import Shard
from schemas.catalogue import ARTIFACTS
from schemas.touch import TOUCH
from tests.contrib.exports.test_exports import data  # noqa: F401


@pytest.fixture(params=["surfaces", "grasps", "vision", "touch"])
def shard(request: pytest.FixtureRequest, data: Path) -> Shard:  # noqa: F811
    return DataDirectory(data).collection(ARTIFACTS[request.param]).first


@pytest.fixture
def values(shard: Shard) -> dict[str, np.ndarray]:
    """Return the arrays of a shard as this project reads them."""
    return {name: shard.read(name) for name in shard.artifact.arrays if shard.has(name)}


def is_text(array: np.ndarray) -> bool:
    return array.dtype.kind in "OUT"


def assert_same(read: Any, expected: np.ndarray) -> None:
    read = np.asarray(read)
    assert read.shape == expected.shape
    assert is_text(expected) or read.dtype == expected.dtype
    np.testing.assert_array_equal(read, expected)


def open_tensorstore(path: Path) -> Any:
    return tensorstore.open({"driver": "zarr3", "kvstore": {"driver": "file", "path": str(path)}}).result()


def test_tensorstore_reads_numbers_and_refuses_text(shard: Shard, values: dict[str, np.ndarray]) -> None:
    for name, expected in values.items():
        if is_text(expected):
            with pytest.raises(ValueError, match="string data type is not one of the supported"):
                open_tensorstore(shard.path / name)
        else:
            assert_same(open_tensorstore(shard.path / name).read().result(), expected)


def test_records_and_attributes_hold_the_names_that_tensorstore_cannot_read(data: Path) -> None:  # noqa: F811
    record = json.loads((data / "grasps" / "0000-of-0001.json").read_text())
    grasps = DataDirectory(data).collection(ARTIFACTS["grasps"]).first
    for name in ("object_id", "category", "split"):
        assert [row[name] for row in record["rows"]] == grasps.read(name).tolist()


def test_zarrs_reads_the_same_as_zarr(shard: Shard, values: dict[str, np.ndarray]) -> None:
    with zarr.config.set({"codec_pipeline.path": "zarrs.ZarrsCodecPipeline"}):
        group: Any = zarr.open_group(str(shard.path), mode="r")
        for name, expected in values.items():
            assert_same(group[name][...], expected)
            assert_same(group[name][-1:], expected[-1:])


def test_zarrita_reads_pixels_where_the_shape_says(shard: Shard, values: dict[str, np.ndarray], tmp_path: Path) -> None:
    script = Path(__file__).with_name("read_with_zarrita.mjs").read_text()
    command = ["node", "--input-type=module", "-", str(shard.path), str(tmp_path), *values]
    subprocess.run(command, input=script, text=True, check=True, cwd=sys.prefix)
    for name, read in json.loads((tmp_path / "shapes.json").read_text()).items():
        if read["values"] is None:
            numbers = np.frombuffer((tmp_path / f"{name}.bin").read_bytes(), values[name].dtype)
        else:
            numbers = np.array(read["values"])
        assert_same(numbers.reshape(read["shape"]), values[name])


def test_plain_xarray_reads_labels_and_values(shard: Shard, values: dict[str, np.ndarray]) -> None:
    opened = xarray.open_zarr(shard.path, consolidated=False)
    for name, expected in values.items():
        assert_same(opened[name].values, expected)
    assert opened.indexes["object"].tolist() == opened.object_id.values.tolist()


def test_damaged_chunk_is_an_error_in_readers_that_compare_checksums(data: Path, tmp_path: Path) -> None:  # noqa: F811
    copy = tmp_path / "copy.zarr"
    shutil.copytree(DataDirectory(data).collection(TOUCH).first.path, copy)
    (file,) = (path for path in (copy / "depth" / "c").rglob("*") if path.is_file())
    content = bytearray(file.read_bytes())
    content[1000] ^= 1
    file.write_bytes(content)
    with pytest.raises(ValueError, match="checksum"):
        zarr.open_group(str(copy), mode="r")["depth"][0, 0]  # type: ignore[index]
    with pytest.raises(ValueError, match="DATA_LOSS"):
        open_tensorstore(copy / "depth")[0, 0].read().result()
    with zarr.config.set({"codec_pipeline.path": "zarrs.ZarrsCodecPipeline"}), pytest.raises(RuntimeError, match="checksum is invalid"):
        zarr.open_group(str(copy), mode="r")["depth"][...]  # type: ignore[index]


def test_netcdf_holds_every_value_for_netcdf_and_hdf5(shard: Shard, data: Path, tmp_path: Path) -> None:  # noqa: F811
    opened = open_artifact(data, shard.artifact.name)
    opened.to_netcdf(tmp_path / "copy.nc")
    with xarray.open_dataset(tmp_path / "copy.nc") as copy:
        assert copy.equals(opened)
        assert copy.attrs == opened.attrs
    with netCDF4.Dataset(tmp_path / "copy.nc") as netcdf, h5py.File(tmp_path / "copy.nc") as hdf5:
        for name, array in opened.data_vars.items():
            np.testing.assert_array_equal(netcdf[name][...], array.values)
            if not is_text(array):
                np.testing.assert_array_equal(hdf5[name][...], array.values)
