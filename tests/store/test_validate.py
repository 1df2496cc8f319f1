"""`validate` rejects damaged data and names array and reason."""

import gc
import hashlib
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr

from pipeline.errors import StoreError
from pipeline.store.digest import of_json
from pipeline.store.validate import problems_below
from schemas.catalogue import ARTIFACTS
from tests.engine.tiny_stages import NOISE, published, request, run


@pytest.fixture(scope="module", autouse=True)
def noise_in_catalogue():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ARTIFACTS, "noise", NOISE)
        yield


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("made")
    run(request(data))
    return data


@pytest.fixture
def shard(original, tmp_path) -> Path:
    """Copy the dataset and return the group of the copy."""
    return published(Path(shutil.copytree(original, tmp_path / "data"))).first.path


def problems(shard: Path) -> list[str]:
    return [line for lines in problems_below(shard.parent.parent).values() for line in lines]


def rewrite(shard: Path, array: str, **changes: object) -> None:
    path = shard / array / "zarr.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def resealed(record: bytes, **changes: object) -> bytes:
    """Change a record's content and set its checksum to match."""
    content = {name: value for name, value in json.loads(record).items() if name != "checksum"} | changes
    return json.dumps(content | {"checksum": of_json(content)}).encode()


def replace_array(shard: Path, name: str, shape: tuple[int, ...], dtype: str, dims: tuple[str, ...]) -> None:
    shutil.rmtree(shard / name)
    zarr.open_group(str(shard)).create_array(name, shape=shape, dtype=dtype, dimension_names=dims)


def set_value(shard: Path, array: str, index: object, value: object) -> None:
    zarr.open_group(str(shard), mode="r+")[array][index] = value


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "array removed": (lambda shard: shutil.rmtree(shard / "values"), "^values: the array is missing"),
    "array added": (lambda shard: shutil.copytree(shard / "values", shard / "walues"), "^walues: the schema has no such array"),
    "dtype": (
        lambda shard: replace_array(shard, "values", (5, 50, 3), "float64", ("object", "sample", "xyz")),
        "^values: dtype is float64, the schema says float32",
    ),
    "dimension's name": (
        lambda shard: rewrite(shard, "values", dimension_names=["object", "point", "xyz"]),
        "values: dimensions are .'object', 'point', 'xyz'.",
    ),
    "dimension's size": (
        lambda shard: replace_array(shard, "reach", (50, 4), "float64", ("sample", "xyz")),
        "^reach: dimension xyz has size 4, the schema says 3",
    ),
    "value": (lambda shard: set_value(shard, "values", (2, 0, 0), np.nan), "c is damaged; `vt-pipeline run make-noise --check`"),
    "category": (lambda shard: set_value(shard, "category", 2, "digit"), "^category: c has 'digit', its record says 'letter'"),
    "object_id": (lambda shard: set_value(shard, "object_id", 2, "digit"), "^object_id: c has"),
    "attribute": (lambda shard: zarr.open_group(str(shard), mode="r+").attrs.update(seed=1), "zarr.json differs from what was written"),
    "group removed": (shutil.rmtree, "cannot be read .No such file or directory."),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGE.values(), ids=DAMAGE)
def test_damaged_group_is_reported(shard, damage, message):
    assert problems(shard) == []
    damage(shard)
    assert any(re.search(message, line) for line in problems(shard))


def test_flipped_bit_in_a_chunk_is_reported(shard):
    for array in ("values", "ok", "reach", "object_id", "lists/c/numbers"):
        (chunk,) = (path for path in (shard / array / "c").rglob("*") if path.is_file())
        whole = chunk.read_bytes()
        content = bytearray(whole)
        content[len(content) // 2] ^= 1
        chunk.write_bytes(content)
        assert re.search(f"{array}( of a)? cannot be read", problems(shard)[0])
        chunk.write_bytes(whole)


def test_unreadable_metadata_is_reported_without_tracebacks(shard, caplog):
    for array in ("values", "ok", "split", "category"):
        rewrite(shard, array, zarr_format="none")
    (line,) = problems(shard)
    assert "category/zarr.json differs from what was written" in line
    gc.collect()
    assert not caplog.records


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the record is damaged"),
        (b"{}", "the record is damaged"),
        (b"[" * 100_000, "the record is damaged"),
        (lambda text: text.replace(b"letter", b"lettes"), "its checksum is not that of its content"),
        (lambda text: resealed(text, schema_version=0), "has schema version 0, not 1"),
        (lambda text: resealed(text, location="../../outside"), "the record is damaged (1 validation error"),
        (lambda text: resealed(text, key="../../../../OWNED"), "the record is damaged (1 validation error"),
        (lambda text: resealed(text, models={"../../outside": "0" * 64}), "the record is damaged (1 validation error"),
    ],
    ids=["empty", "other", "nested", "flipped", "version", "location", "key", "model"],
)
def test_damaged_record_is_reported(shard, content, message):
    record = shard.parent / "0000-of-0001.json"
    record.write_bytes(content if isinstance(content, bytes) else content(record.read_bytes()))
    assert any(message in line for line in problems(shard))


def replace_metadata(shard: Path, name: str, content: bytes) -> None:
    """Write the `zarr.json` of an array or the group, and record its digest: a foreign store that is consistent."""
    (shard / name / "zarr.json").write_bytes(content)
    record = shard.parent / "0000-of-0001.json"
    digests = json.loads(record.read_bytes())["metadata"] | {name: hashlib.sha256(content).hexdigest()}
    record.write_bytes(resealed(record.read_bytes(), metadata=digests))


@pytest.mark.parametrize(
    "content", [b"{", b"[" * 100_000, b'{"zarr_format": 4, "node_type": "group"}', b'{"zarr_format": 3, "node_type": "array"}']
)
def test_group_with_recorded_metadata_of_no_group_is_reported(shard, content):
    replace_metadata(shard, "", content)
    assert "its attributes cannot be used" in problems(shard)[0]


def test_group_or_array_of_another_dtype_in_place_of_an_array_is_refused(shard):
    group, text = b'{"zarr_format": 3, "node_type": "group"}', (shard / "label" / "zarr.json").read_bytes()
    for metadata, words in ((group, "values cannot be opened"), (text, "values: dtype is string, the schema says float32")):
        replace_metadata(shard, "values", metadata)
        with pytest.raises(StoreError, match=words):
            published(shard.parent.parent).first.stored("values")


def test_record_with_more_rows_than_the_arrays_is_refused(shard):
    record = shard.parent / "0000-of-0001.json"
    first, *_ = rows = json.loads(record.read_bytes())["rows"]
    record.write_bytes(resealed(record.read_bytes(), rows=[*rows, {**first, "object_id": "z"}]))
    with pytest.raises(StoreError, match="values: it has 5 rows, the record 6"):
        published(shard.parent.parent).first.stored("values")
    assert "it has 5 rows, the record 6" in problems(shard)[0]


def test_attributes_that_are_not_json_are_refused(shard):
    content = json.loads((shard / "zarr.json").read_bytes())
    content["attributes"]["seed"] = float("nan")
    replace_metadata(shard, "", json.dumps(content).encode())
    with pytest.raises(StoreError, match="its attributes cannot be used"):
        published(shard.parent.parent).first.attributes  # noqa: B018


@pytest.mark.parametrize("file", ["chunk", "zarr.json", "values/zarr.json", "record", "dataset.json"])
def test_pointer_of_git_lfs_is_named(shard: Path, file: str) -> None:
    paths = {
        "chunk": next(path for path in (shard / "values" / "c").rglob("*") if path.is_file()),
        "record": next(shard.parent.glob("*.json")),
        "dataset.json": shard.parent.parent / "dataset.json",
    }
    path = paths.get(file, shard / file)
    assert path.is_file()
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * "5" + "\nsize 70000\n")
    try:
        lines = problems(shard)
    except StoreError as error:  # without a record, or the number of shards, nothing can be checked
        lines = [str(error)]
    assert any(f"{path} is a Git LFS pointer; run `git lfs pull`" in line for line in lines)
