"""Damaged artifacts are detected before use, reported with the command that repairs them, and made again."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr

from pipeline.engine.stage import Unit
from pipeline.errors import StoreError
from pipeline.store import garbage
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from pipeline.store.record import named_location
from pipeline.store.rows import Result, Row
from pipeline.store.validate import problems_below
from pipeline.tables.status import read_account
from schemas.base import Array
from schemas.catalogue import ARTIFACTS
from tests.command_line import vt
from tests.engine.tiny_stages import (
    CONSOLE,
    MEAN,
    Average,
    MakeNoise,
    TakeMean,
    digest,
    leave_row,
    pack,
    plan_of,
    publish,
    published,
    request,
    run,
)

TOKEN = "0123456789abcdef" * 2
"""A token in the name of an unfinished file."""


def flip(path: Path) -> None:
    """Flip one bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def group(data: Path) -> Path:
    return published(data).first.path


@pytest.mark.parametrize(
    ("damage", "options"),
    [
        (lambda content: b"", {}),
        (lambda content: content[:100], {"strict": True}),
        (lambda content: content[:-400] + bytes(400), {"retry": True}),
    ],
)
def test_a_damaged_row_file_is_made_again(tmp_path, damage, options):
    leave_row(request(tmp_path), "c")
    plan = plan_of(request(tmp_path))
    assert plan.shard is None, "the others are missing"
    file = plan.rows.path("c", plan.units[2].key)
    file.write_bytes(damage(file.read_bytes()))
    assert run(request(tmp_path, **options)) == 5


def test_a_row_file_of_another_object_is_not_published(tmp_path):
    leave_row(request(tmp_path), "c")
    plan = plan_of(request(tmp_path))
    copied = plan.rows.path("d", plan.units[3].key)
    copied.parent.mkdir()
    shutil.copy(plan.rows.path("c", plan.units[2].key), copied)
    assert run(request(tmp_path)) == 4


def test_flipped_bit_in_a_row_file_is_detected_at_publishing_and_the_row_is_made_again(tmp_path):
    leave_row(request(tmp_path), "c")
    plan = plan_of(request(tmp_path))
    file = plan.rows.path("c", plan.units[2].key)
    content = bytearray(file.read_bytes())
    content[7] ^= 1  # in the first chunk
    file.write_bytes(content)
    with pytest.raises(StoreError, match="was damaged or is gone; run again"):
        run(request(tmp_path))
    assert run(request(tmp_path)) == 1


@pytest.mark.parametrize("damage", [Path.unlink, lambda file: file.write_bytes(b"")], ids=["missing", "empty"])
@pytest.mark.parametrize("name", ["zarr.json", "c/0"])
def test_ragged_array_with_a_missing_file_is_not_up_to_date(tmp_path, damage, name):
    run(request(tmp_path))
    assert plan_of(request(tmp_path)).up_to_date()
    damage(group(tmp_path) / "lists" / "c" / "numbers" / name)
    assert not plan_of(request(tmp_path)).up_to_date()


@pytest.mark.parametrize("damage", [Path.unlink, lambda chunk: chunk.write_bytes(b"")], ids=["missing", "empty"])
def test_missing_or_empty_chunk_is_not_read_as_zeros(tmp_path, damage):
    run(request(tmp_path))
    for chunk in (path for path in (published(tmp_path).first.path / "values" / "c").rglob("*") if path.is_file()):
        damage(chunk)
    message = r"of values 1 of 1 files are missing or empty; `vt-pipeline run make-noise --check`"
    with pytest.raises(StoreError, match=message):
        run(request(tmp_path, stage=TakeMean()))
    with pytest.raises(StoreError, match=message):  # every reader refuses it, training included
        published(tmp_path).view("b")["values"]
    (problems,) = (lines for lines in problems_below(tmp_path).values() if lines)
    assert "files are missing or empty" in problems[0]
    assert run(request(tmp_path)) == 5, "up to date means complete"


@pytest.mark.parametrize("array", ["", "values", "label"])
def test_changed_metadata_is_refused_and_restored_by_a_run(tmp_path, array):
    run(request(tmp_path))
    whole = digest(tmp_path)
    metadata = group(tmp_path) / array / "zarr.json"
    metadata.write_text(metadata.read_text().replace('"node_type"', '"node_typ"', 1))
    with pytest.raises(StoreError, match=r"zarr.json differs from what was written; `vt-pipeline run make-noise --check`"):
        published(tmp_path).view("b")[array or "values"]
    assert run(request(tmp_path)) == 5, "its size differs from the record"
    run(request(tmp_path, check=True))
    assert digest(tmp_path) == whole
    assert not any(problems_below(tmp_path).values())
    metadata.unlink()
    with pytest.raises(StoreError, match=r"zarr\.json cannot be read"):
        published(tmp_path).view("b")[array or "values"]


def test_check_makes_a_damaged_row_again_and_keeps_the_others(tmp_path):
    run(request(tmp_path))
    whole = digest(tmp_path)
    zarr.open_group(str(group(tmp_path)), mode="r+")["values"][2, 0, 0] = 7.0  # the checksum matches: only the row's digest differs
    assert run(request(tmp_path)) == 0, "not read, not found"
    stage = Average()
    with pytest.raises(StoreError, match="c is damaged; `vt-pipeline run make-noise --check`"):
        plan_of(request(tmp_path, stage)).make(CONSOLE)
    assert not stage.made
    assert run(request(tmp_path, check=True)) == 1
    assert run(request(tmp_path, check=True)) == 0
    assert digest(tmp_path) == whole
    assert not any(problems_below(tmp_path).values())


def test_check_makes_a_damaged_folder_again(tmp_path):
    run(request(tmp_path))
    run(request(tmp_path, Average()))
    flip(DataDirectory(tmp_path).folder_path("models/average") / "mean.json")
    assert plan_of(request(tmp_path, Average())).up_to_date()
    assert run(request(tmp_path, Average(), check=True)) == 5
    assert plan_of(request(tmp_path, Average(), check=True)).up_to_date()
    for stray in (".DS_Store", "note.txt"):
        (DataDirectory(tmp_path).folder_path("models/average") / stray).write_text("of mine")
    assert plan_of(request(tmp_path, Average(), check=True)).up_to_date(), "what was written is there"
    (line,) = problems_below(tmp_path)[tmp_path / "models/average.json"]
    assert line == "note.txt was not written by average"


def test_validate_reports_a_folder_without_a_record(tmp_path):
    run(request(tmp_path))
    run(request(tmp_path, Average()))
    (record := tmp_path / "models" / "average.json").unlink()
    ((path, lines),) = ((path, lines) for path, lines in problems_below(tmp_path).items() if lines)
    assert path == record
    assert "is missing: a run was killed, or it was deleted; run its stage again" in lines[0]
    run(request(tmp_path, Average()))
    assert not any(problems_below(tmp_path).values())


def test_record_of_another_format_is_not_reported_as_damaged(tmp_path):
    run(request(tmp_path))
    record = tmp_path / "noise" / "0000-of-0001.json"
    record.write_text(record.read_text().replace('"format": 2', '"format": 3'))
    with pytest.raises(
        StoreError, match=r"the record is of format 3, this version of vt-pipeline reads format 2; use the version that wrote it"
    ):
        published(tmp_path)
    account = read_account(tmp_path)
    assert (account.damaged, len(account.other_versions)) == ([], 1)


def test_status_lists_damaged_records_and_the_remaining_artifacts(tmp_path):
    for stage in (MakeNoise(), TakeMean(), Average()):
        run(request(tmp_path, stage))
    whole = digest(tmp_path, MEAN)
    flip(tmp_path / "mean" / "0000-of-0001.json")
    account = read_account(tmp_path)
    assert ["mean/0000-of-0001.json: the record is damaged" in line for line in account.damaged] == [True]
    assert [listed.artifact for listed in account.artifacts] == ["noise"]
    assert [listed.folder for listed in account.folders] == ["models/average"]
    assert json.loads(account.to_json())["damaged"] == account.damaged
    (DataDirectory(tmp_path).folder_path("models/average") / "mean.json").unlink()
    assert any("average.json: mean.json is missing; run average again" in line for line in read_account(tmp_path).damaged)
    assert run(request(tmp_path, TakeMean())) == 5, "its stage makes it again"
    assert digest(tmp_path, MEAN) == whole


def test_missing_shard_record_and_folders_in_place_of_files_are_reported(tmp_path):
    for stage in (MakeNoise(), TakeMean(), Average()):
        run(request(tmp_path, stage))
    (tmp_path / "mean/0000-of-0001.json").rename(tmp_path / "kept")
    problems = problems_below(tmp_path)[tmp_path / "mean/0000-of-0001.json"]
    assert ["the record of 0000-of-0001" in line for line in problems] == [True]
    (tmp_path / "kept").rename(tmp_path / "mean/0000-of-0001.json")
    assert not any(problems_below(tmp_path).values())
    mean_file = DataDirectory(tmp_path).folder_path("models/average") / "mean.json"
    for file, message in ((mean_file, "mean.json is missing"), (tmp_path / "models/average.json", "the record of average-")):
        content = file.read_text()
        file.unlink()
        file.mkdir()
        assert any(message in line for lines in problems_below(tmp_path).values() for line in lines)
        file.rmdir()
        file.write_text(content)


def test_array_of_only_some_objects_is_refused_before_publishing(tmp_path, monkeypatch):
    stage = MakeNoise()
    arrays = stage.output.arrays | {"weight": Array("object", "float32", "kg", "Of some.", optional=True)}
    stage.output = stage.output.model_copy(update={"arrays": arrays})
    monkeypatch.setitem(ARTIFACTS, "noise", stage.output)

    def row(unit: Unit) -> Row:
        weight = {"weight": np.array(1.0)} if unit.name == "b" else {}
        return {"values": np.zeros((50, 3)), "label": np.array("x"), "lists/numbers": np.arange(1), **weight}

    with pytest.raises(StoreError, match="noise: weight: returned for b, not for a; return it for all, or for none"):
        pack(request(tmp_path, stage, count=3), row)
    assert not list((tmp_path / "noise").glob("*"))
    pack(request(tmp_path / "failed", stage, count=2), row, failed="a")
    assert not any(problems_below(tmp_path / "failed").values()), "a failed object has no array"


def test_temporary_files_of_killed_runs_are_garbage(tmp_path):
    run(request(tmp_path))
    leftovers = [tmp_path / f"dataset.json.{TOKEN}.tmp", tmp_path / "noise" / f"0000-of-0001.json.{TOKEN}.tmp"]
    for path in leftovers:
        path.write_text("half")
    leftovers.append(tmp_path / "noise" / "0000-of-0001-0123456789abcdef.zarr.tmp")
    leftovers[-1].mkdir()
    assert collect_everything(DataDirectory(tmp_path), older_than=-1) == [leftovers[0], leftovers[2], leftovers[1]]


def test_rows_of_a_run_killed_after_it_published_them_are_garbage_after_a_week(tmp_path):
    run(request(tmp_path))
    plan = plan_of(request(tmp_path))
    for key in (plan.units[0].key, "0" * 64):
        plan.rows.save(Result(name="a", key=key), {})
    paths = [plan.rows.path("a", key) for key in (plan.units[0].key, "0" * 64)]
    assert collect_everything(DataDirectory(tmp_path), older_than=-1) == [], "a run may be about to publish it again"
    for path in paths:
        os.utime(path, (0, 0))
    assert collect_everything(DataDirectory(tmp_path)) == [paths[0]]
    assert [path.exists() for path in paths] == [False, True], "the other row is not published yet"


def test_garbage_collection_and_validation_leave_files_of_the_user_alone(tmp_path):
    run(request(tmp_path))
    names = ("notes.tmp", "run-0123456789abcdef", "noise/notes.tmp", "noise/run-0123456789abcdef.zarr", "noise/0000-of-0001-0123.zarr")
    for name in names:
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (0, 0))
    old = publish_evaluation(tmp_path, "second")
    new = publish_evaluation(tmp_path, "third")
    os.utime(old, (0, 0))
    publish_evaluation(tmp_path, "third")
    assert [old.exists(), new.exists()] == [False, True], "a replaced version is collected"
    assert all((tmp_path / name).exists() for name in names)
    assert not any(problems_below(tmp_path).values())
    collect_everything(DataDirectory(tmp_path), older_than=-1)
    assert all((tmp_path / name).exists() for name in names)


def publish_evaluation(data: Path, content: str) -> Path:
    (filled := data / ".work" / "evaluation" / "filled").mkdir(parents=True, exist_ok=True)
    (filled / "scores").write_text(content)
    return publish(data, "evaluation", filled, "evaluate")


def test_garbage_is_collected_in_data_directories_only(tmp_path):
    (leftover := tmp_path / f"notes.{TOKEN}.tmp").touch()
    printed = vt("collect-garbage", tmp_path, "--older-than", "0", fails=True)
    assert "is not a data directory; make one with" in printed
    assert leftover.exists()


def test_publishing_collects_old_groups_and_reads_only_their_records(tmp_path, monkeypatch):
    run(request(tmp_path, shards=3))
    replaced = published(tmp_path).shards[0].path
    run(request(tmp_path, shards=3, settings={"samples": 9}), shard=1)
    (lost := tmp_path / "noise" / "0009-of-0009-0123456789abcdef.zarr").mkdir()
    for path in (replaced, lost):
        assert path.exists(), "readers may have it open"
        os.utime(path, (0, 0))
    read: list[str] = []
    monkeypatch.setattr(garbage, "named_location", lambda path: read.append(path.name) or named_location(path))
    run(request(tmp_path, shards=3, settings={"samples": 9}), shard=2)
    assert read == ["0001-of-0003.json"]
    assert not replaced.exists()
    assert not lost.exists(), "it has no record"


def test_garbage_collection_does_not_follow_links(tmp_path):
    data, elsewhere = tmp_path / "data", tmp_path / "elsewhere"
    run(request(data))
    (data / "noise").rename(elsewhere)
    (data / "noise").symlink_to(elsewhere)
    run(request(data, settings={"samples": 9}))  # collects the replaced groups
    others = [elsewhere / f"mine.{TOKEN}.tmp", elsewhere / "0001-of-0001-0123456789abcdef.zarr" / "one.png"]
    for path in others:
        path.parent.mkdir(exist_ok=True)
        path.write_text("of value")
    (data / f"noted.json.{TOKEN}.tmp").symlink_to(others[0])
    (data / "evaluation-0123456789abcdef").symlink_to(others[1].parent)
    groups = sorted(elsewhere.glob("0000*.zarr"))
    for path in (data, tmp_path / "linked"):
        if path != data:
            path.symlink_to(data)
        printed = vt("collect-garbage", path, "--older-than", "0")
        assert f"{path / 'noise'} is a symbolic link: nothing is removed from {elsewhere}" in printed
    assert not list(data.glob("*-0123456789abcdef"))
    assert not list(data.glob("*.tmp"))
    assert all(path.read_text() == "of value" for path in others)
    assert len(groups) == 2
    assert sorted(elsewhere.glob("0000*.zarr")) == groups


def test_number_of_shards_is_that_of_the_records(tmp_path):
    run(request(tmp_path))
    (tmp_path / "dataset.json").unlink()
    assert run(request(tmp_path)) == 0
    (tmp_path / "dataset.json").write_text('{"shards": 3}')
    with pytest.raises(StoreError, match=r"names 3 shards, but no record has that number; .* as the records are named: 1$"):
        run(request(tmp_path))


def test_shard_of_another_schema_version_is_made_again(tmp_path):
    run(request(tmp_path))
    newer = MakeNoise(version=2)
    assert run(request(tmp_path, newer)) == 5
    assert published(tmp_path, newer.output).first.artifact.version == 2
