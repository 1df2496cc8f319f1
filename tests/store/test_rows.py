"""Rows are checked, encoded and written; groups of them are equal to those that Zarr writes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numcodecs import blosc
from pydantic_zarr.v3 import ArraySpec, GroupSpec, from_flat_group
from zarr.storage import LocalStore

from pipeline.errors import StoreError
from pipeline.store.layout import LEVEL, OBJECTS_PER_FILE, array_metadata, decode_array, encode_array, schema_name, without_checksum
from pipeline.store.publish import write_group
from pipeline.store.record import Failure, RowRecord
from pipeline.store.rows import Result, Row, RowFiles, conform
from schemas.base import COMMON, Array, Artifact

ARTIFACT = Artifact(
    name="encoded",
    version=1,
    summary="Every kind of array.",
    arrays={
        "image": Array("object row col rgb", "uint8", "1", "An object a chunk."),
        "views": Array("object grasp row col rgb", "uint8", "1", "A grasp a chunk."),
        "depth": Array("object grasp row col", "float32", "m", "A grasp a chunk."),
        "points": Array("object point xyz", "float64", "m", "An object a chunk."),
        "pose": Array("object pose_row pose_column", "float64", "m", "Several objects a chunk."),
        "icon": Array("object pose_row pose_column rgb", "uint8", "1", "Several objects a chunk."),
        "flag": Array("object", "bool", "1", "A number per object."),
        "label": Array("object", "string", "1", "A word."),
        "scale": Array("xyz", "float32", "m", "A constant."),
    },
    ragged={"meshes/faces": Array("face corner", "int32", "1", "Ragged."), "meshes/texture": Array("row col rgb", "uint8", "1", "…")},
)
CONSTANTS: Row = {"scale": np.array([1, 2, 3], np.float32)}
FAILED = 3


def row(number: int) -> Row:
    """Make a row of random arrays, some constant, some empty."""
    rng = np.random.default_rng(number)
    return {
        "image": rng.integers(0, 256, (80, 90, 3), np.uint8),
        "views": rng.integers(0, 256, (2, 80, 90, 3), np.uint8),
        "depth": np.zeros((2, 80, 90), np.float32) if number == 1 else rng.normal(size=(2, 80, 90)).astype(np.float32),
        "points": rng.normal(size=(1000, 3)),
        "pose": rng.normal(size=(4, 4)),
        "icon": rng.integers(0, 256, (4, 4, 3), np.uint8),
        "flag": np.array(number % 2 == 0),
        "label": np.array(f"wörd {number}"),
        "meshes/faces": rng.integers(0, 9, (number % 4, 3), np.int32),
        "meshes/texture": rng.integers(0, 256, (number + 1, 7, 3), np.uint8),
    }


def write_rows(path: Path, count: int) -> list[Row]:
    """Write a group of encoded rows, one of them failed; return the rows."""
    rows = [{} if number == FAILED else row(number) for number in range(count)]
    records = [
        RowRecord(
            **{"object_id": f"object-{number}", "category": "thing", "split": "train", "key": "0" * 64, "digest": "0" * 64},
            **{"inputs": {}, "seconds": 0.0, "failure": None if arrays else Failure(stage="s", reason="r")},
        )
        for number, arrays in enumerate(rows)
    ]
    files = RowFiles(path.with_suffix(".work"), ARTIFACT)
    results = [files.save(Result(name=f"object-{number}", key="0"), arrays) for number, arrays in enumerate(rows)]
    write_group(path, ARTIFACT, records, results, files, CONSTANTS, {"a": 1})
    return rows


def write_with_zarr(path: Path, rows: list[Row]) -> Any:
    """Write the same values with Zarr alone."""
    shapes = {name: (len(rows), *value.shape) for name, value in rows[0].items() if "/" not in name}
    shapes |= dict.fromkeys(COMMON, (len(rows),)) | {"scale": (3,)}
    ragged = {f"meshes/object-{n}/{name[7:]}": value for n, arrays in enumerate(rows) for name, value in arrays.items() if "/" in name}
    with zarr.config.set({"array.write_empty_chunks": True}):
        shapes |= {name: value.shape for name, value in ragged.items()}
        specs = {f"/{name}": ArraySpec(**array_metadata(ARTIFACT.of(schema_name(name)), shape)) for name, shape in shapes.items()}
        group: Any = from_flat_group({"": GroupSpec(attributes={"a": 1}, members=None), **specs}).to_zarr(LocalStore(path), path="")
        for name, value in {**ragged, **CONSTANTS}.items():
            group[name][...] = value
        for name in ARTIFACT.arrays.keys() & rows[0].keys():
            for number, arrays in enumerate(rows):
                if arrays:
                    group[name][number] = str(arrays[name]) if name == "label" else arrays[name]
        for name in ("object", "object_id"):
            group[name][:] = np.array([f"object-{number}" for number in range(len(rows))], object)
        group["category"][:], group["split"][:] = "thing", "train"
        group["ok"][:] = [bool(arrays) for arrays in rows]
    return group


@pytest.mark.parametrize("count", [1, 5, OBJECTS_PER_FILE + 5])
def test_group_of_encoded_rows_equals_the_group_that_zarr_writes(tmp_path: Path, count: int) -> None:
    rows = write_rows(tmp_path / "ours", count)
    expected = write_with_zarr(tmp_path / "zarr", rows)
    ours: Any = zarr.open_group(str(tmp_path / "ours"), mode="r")
    metadata = [
        {path.relative_to(folder): path.read_text() for path in folder.rglob("zarr.json")}
        for folder in (tmp_path / "ours", tmp_path / "zarr")
    ]
    assert metadata[0] == metadata[1]
    files = [
        {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()} for folder in (tmp_path / "ours", tmp_path / "zarr")
    ]
    assert files[0] >= files[1], "and files of failed objects alone, which have no chunk"
    for path in (path.parent.as_posix() for path in metadata[0]):
        if isinstance(expected[path] if path != "." else expected, zarr.Array):
            np.testing.assert_array_equal(ours[path][...], expected[path][...], err_msg=path)


def test_flipped_bit_is_detected_by_the_checksum_of_its_chunk(tmp_path: Path) -> None:
    write_rows(tmp_path / "group", 2)
    file = tmp_path / "group" / "points" / "c" / "0" / "0" / "0"
    content = bytearray(file.read_bytes())
    content[1000] ^= 1
    file.write_bytes(content)
    ours: Any = zarr.open_group(str(tmp_path / "group"), mode="r")
    with pytest.raises(ValueError, match="checksum"):
        ours["points"][0]


def test_saved_row_is_loaded_unchanged_and_a_damaged_row_file_is_removed(tmp_path: Path) -> None:
    files, saved = RowFiles(tmp_path, ARTIFACT), row(5)
    result = files.save(Result(name="a", key="k", seconds=1.5), saved, "thing")
    assert files.find("a", "k") == result
    loaded = files.load(result)
    assert list(loaded) == list(saved)
    for name, value in saved.items():
        assert loaded[name].dtype == value.dtype
        np.testing.assert_array_equal(loaded[name], value)
    path = tmp_path / "rows" / "a" / "k.row"
    content = bytearray(path.read_bytes())
    content[100] ^= 1
    path.write_bytes(content)
    with pytest.raises(StoreError, match="was damaged or is gone; run again"):
        files.chunks(result)
    assert files.find("a", "k") is None


@pytest.mark.parametrize("values", [np.zeros((0, 3), np.float32), np.array(2.5), np.array(["a", "b"]), np.arange(6).reshape(2, 3)])
def test_undeclared_arrays_survive_encoding(values: np.ndarray) -> None:
    decoded = decode_array(None, values.shape, values.dtype.str, encode_array(None, values))
    np.testing.assert_array_equal(decoded, values)
    assert decoded.dtype == values.dtype


def test_images_are_compressed_in_their_own_order_with_colours_together() -> None:
    row, col = np.mgrid[:80, :90]
    noise = np.random.default_rng(0).integers(0, 2, (80, 90, 1))
    image = (np.stack([60 + row, 200 - col, 90 + (row + col) // 2], axis=-1) + noise).astype(np.uint8)
    (chunk,) = encode_array(ARTIFACT.arrays["image"], image)
    assert blosc.decompress(without_checksum(chunk)) == image.tobytes()
    assert len(chunk) < 0.6 * len(blosc.compress(image, b"zstd", LEVEL, blosc.NOSHUFFLE, 0, 1))


def test_equal_values_are_encoded_as_equal_bytes() -> None:
    for name, value in row(2).items():
        assert encode_array(ARTIFACT.of(name), value) == encode_array(ARTIFACT.of(name), value.copy())


RANGES = Artifact(
    name="ranges", version=1, summary="Distances.", arrays={"depth": Array("object pixel", "float32", "m", "Distance.", infinite=True)}
)


def test_infinite_arrays_hold_positive_infinity_only():
    (stored,) = conform(RANGES, {"depth": np.array([1, np.inf])}).values()
    assert stored.tolist() == [1, np.inf]
    for value in (-np.inf, np.nan):
        with pytest.raises(ValueError, match="depth holds a value that is not finite"):
            conform(RANGES, {"depth": np.array([1, value])})
