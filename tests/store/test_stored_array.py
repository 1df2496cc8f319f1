"""What is read without Zarr equals what Zarr reads, and what was written."""

import json
from pathlib import Path

import numpy as np
import pytest
import zarr

from pipeline.store.layout import OBJECTS_PER_FILE, array_metadata, schema_name
from pipeline.store.stored_array import StoredArray
from pipeline.store.zarr_files import open_array, zarr_store
from tests.store.test_rows import ARTIFACT, CONSTANTS, write_rows


def opened(path: Path, name: str) -> StoredArray:
    return StoredArray.open(path / name, (path / name / "zarr.json").read_bytes())


@pytest.mark.parametrize("count", [1, 2, OBJECTS_PER_FILE + 6])
def test_entries_equal_the_rows_and_those_of_zarr(count: int, tmp_path: Path) -> None:
    rows = write_rows(tmp_path / "a.zarr", count)
    group = zarr.open_group(zarr_store(tmp_path / "a.zarr"), mode="r")
    for number in {0, 1, count - 1} & {*range(count)}:
        for name, written in rows[number].items():
            array = ARTIFACT.of(name)
            if "/" in name:
                path, position = f"meshes/object-{number}/{name[7:]}", None
            else:
                path, position = name, number
            stored = opened(tmp_path / "a.zarr", path)
            assert stored.has_layout_of(array)
            entry = stored.read(array, position)
            by_zarr = np.asarray(group[path][... if position is None else position])
            assert (entry.dtype, entry.shape) == (by_zarr.dtype, by_zarr.shape)
            np.testing.assert_array_equal(entry, by_zarr)
            np.testing.assert_array_equal(entry, written)
            assert entry.flags.writeable
    np.testing.assert_array_equal(opened(tmp_path / "a.zarr", "scale").read(ARTIFACT.of("scale")), CONSTANTS["scale"])
    names = opened(tmp_path / "a.zarr", "object").read(ARTIFACT.of("object"), count - 1)
    assert str(names) == f"object-{count - 1}"


@pytest.mark.parametrize("name", ["image", "views", "pose", "label", "scale", "meshes/object-0/texture"])
def test_changed_byte_is_found(name: str, tmp_path: Path) -> None:
    write_rows(tmp_path / "a.zarr", 2)
    array, stored = ARTIFACT.of(schema_name(name)), opened(tmp_path / "a.zarr", name)
    (file,) = (path for path in (tmp_path / "a.zarr" / name / "c").rglob("*") if path.is_file())
    content = file.read_bytes()
    for at in (20, len(content) - 6):
        file.write_bytes(content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :])
        with pytest.raises(ValueError, match="differ from their checksum"):
            stored.read(array, 0 if array.per_object else None)


def test_array_in_another_layout_is_left_to_zarr(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.zarr", 2)
    metadata = json.loads((tmp_path / "a.zarr" / "image" / "zarr.json").read_text())
    metadata["codecs"][0]["configuration"]["codecs"][1]["configuration"]["clevel"] = 3
    assert not StoredArray.open(tmp_path, json.dumps(metadata).encode()).has_layout_of(ARTIFACT.of("image"))


def test_zarr_opens_an_array_by_metadata_that_were_read_without_reading_them_again(tmp_path: Path) -> None:
    rows = write_rows(tmp_path / "a.zarr", 2)
    metadata = opened(tmp_path / "a.zarr", "image").metadata
    for file in (tmp_path / "a.zarr" / "zarr.json", tmp_path / "a.zarr" / "image" / "zarr.json"):
        file.unlink()
    np.testing.assert_array_equal(open_array(tmp_path / "a.zarr", "image", metadata)[1], rows[1]["image"])


def test_rows_of_an_array_larger_than_its_file_are_refused_before_its_chunks_are_listed(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.zarr", 1)
    array, side = ARTIFACT.of("views"), 10**9
    metadata = json.loads((tmp_path / "a.zarr" / "views" / "zarr.json").read_text()) | array_metadata(array, (1, side, side, side, 3))
    stored = StoredArray.open(tmp_path / "a.zarr" / "views", json.dumps(metadata).encode())
    assert stored.has_layout_of(array)
    with pytest.raises((OSError, OverflowError)):
        stored.read(array, 0)
