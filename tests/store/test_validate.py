"""`validate` rejects what is not whole, naming array and reason."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr

from pipeline.store.validate import problems
from tests.runner.tiny import NOISE, request, run


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("made")
    run(request(data))
    return data / "noise" / "0000.zarr"


@pytest.fixture
def shard(made, tmp_path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "0000.zarr"))


def rewrite(shard: Path, array: str, **changes: object) -> None:
    path = shard / array / "zarr.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def only_problem(shard: Path) -> str:
    found = problems(shard, NOISE)
    assert len(found) == 1, found
    return found[0]


def test_a_shard_as_it_was_written_is_valid(shard):
    assert problems(shard, NOISE) == []


def test_a_missing_array(shard):
    shutil.rmtree(shard / "values")
    assert only_problem(shard) == "values: the array is missing"


def test_an_array_no_schema_knows(shard):
    shutil.copytree(shard / "values", shard / "walues")
    assert only_problem(shard) == "walues: the schema knows no such array"


def test_a_wrong_dtype(shard):
    shutil.rmtree(shard / "values")
    zarr.open_group(str(shard)).create_array("values", shape=(5, 50, 3), dtype="float64", dimension_names=("object", "sample", "xyz"))
    assert only_problem(shard) == "values: dtype is float64, the schema says float32"


def test_a_wrong_dimension_name(shard):
    rewrite(shard, "values", dimension_names=["object", "point", "xyz"])
    assert "values: dimensions are ('object', 'point', 'xyz')" in only_problem(shard)


def test_a_dimension_that_differs_between_arrays(shard):
    shutil.rmtree(shard / "reach")
    zarr.open_group(str(shard)).create_array("reach", shape=(50, 4), dtype="float64", dimension_names=("sample", "xyz"))
    assert only_problem(shard) == "reach: dimension xyz has size 4, the schema says 3"


def test_a_nan(shard):
    zarr.open_group(str(shard), mode="r+")["values"][2, 0, 0] = np.nan
    found = problems(shard, NOISE)
    assert found[0] == "values: c holds NaN"


def test_a_value_that_was_changed(shard):
    zarr.open_group(str(shard), mode="r+")["values"][2, 0, 0] = 5
    assert "c: its category or arrays differ from what was written" in only_problem(shard)


@pytest.mark.parametrize("array", ["values", "ok", "reach", "object_id", "lists/c/numbers"])
def test_a_flipped_byte_in_a_chunk(shard, array):
    for chunk in (path for path in (shard / array / "c").rglob("*") if path.is_file()):
        content = bytearray(chunk.read_bytes())
        content[len(content) // 2] ^= 1
        chunk.write_bytes(content)
    name = "lists/numbers: a chunk of c" if "/" in array else array
    assert any(line.startswith(name) for line in problems(shard, NOISE))


def test_a_missing_chunk(shard):
    for chunk in (path for path in (shard / "values" / "c").rglob("*") if path.is_file()):
        chunk.unlink()
    assert "values has lost 1 of its 1 files; delete the shard and run its stage again" in problems(shard, NOISE)[0]


def test_an_incomplete_shard(shard):
    zarr.open_group(str(shard), mode="r+").attrs["complete"] = False
    assert "not marked complete" in only_problem(shard)


def test_another_version_of_the_schema(shard):
    zarr.open_group(str(shard), mode="r+").attrs["schema_version"] = 0
    assert "schema noise is version 1 here, the shard has 0" in only_problem(shard)


def test_no_shard_at_all(tmp_path):
    assert "no Zarr group can be read there" in only_problem(tmp_path / "none.zarr")
