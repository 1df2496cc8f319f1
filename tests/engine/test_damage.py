"""Damage to what was made: found before it is used, told with the command that mends it, made again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import zarr
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.engine.run import run as run_plan
from pipeline.errors import StoreError
from pipeline.reports.status import read_account
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import CONSOLE, Average, MakeNoise, TakeMean, digest, leave_row, plan_of, published, request, run


def flip(path: Path) -> None:
    """Flip one bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def group(data: Path) -> Path:
    return published(data).first.path


@pytest.mark.parametrize("damage", [lambda content: b"", lambda content: content[:100], lambda content: content[:-400] + bytes(400)])
@pytest.mark.parametrize("more", [{}, {"strict": True}, {"retry": True}], ids=str)
def test_a_damaged_row_file_is_made_again(tmp_path, damage, more):
    leave_row(request(tmp_path), "c")
    plan = plan_of(request(tmp_path))
    assert plan.output.shard is None, "the others are missing"
    file = plan.output.rows.path("c", plan.units[2].key)
    file.write_bytes(damage(file.read_bytes()))
    assert run(request(tmp_path, **more)) == 5


def test_a_row_file_of_another_object_is_not_published(tmp_path):
    leave_row(request(tmp_path), "c")
    plan = plan_of(request(tmp_path))
    stolen = plan.output.rows.path("d", plan.units[3].key)
    stolen.parent.mkdir()
    shutil.copy(plan.output.rows.path("c", plan.units[2].key), stolen)
    assert run(request(tmp_path)) == 4


def test_a_row_file_with_a_flipped_bit_is_found_when_it_is_published_and_made_again(tmp_path):
    leave_row(request(tmp_path), "c")
    plan = plan_of(request(tmp_path))
    file = plan.output.rows.path("c", plan.units[2].key)
    content = bytearray(file.read_bytes())
    content[7] ^= 1  # in the first chunk
    file.write_bytes(content)
    with pytest.raises(StoreError, match="was damaged and is removed; run again"):
        run(request(tmp_path))
    assert run(request(tmp_path)) == 1


@pytest.mark.parametrize("damage", [Path.unlink, lambda file: file.write_bytes(b"")], ids=["missing", "empty"])
@pytest.mark.parametrize("name", ["zarr.json", "c/0"])
def test_a_ragged_array_without_one_of_its_files_is_not_up_to_date(tmp_path, damage, name):
    run(request(tmp_path))
    assert plan_of(request(tmp_path)).up_to_date()
    damage(group(tmp_path) / "lists" / "c" / "numbers" / name)
    assert not plan_of(request(tmp_path)).up_to_date()


@pytest.mark.parametrize("damage", [Path.unlink, lambda chunk: chunk.write_bytes(b"")], ids=["missing", "empty"])
def test_a_chunk_that_is_missing_or_empty_is_not_read_as_zeros(tmp_path, damage):
    run(request(tmp_path))
    for chunk in (path for path in (published(tmp_path).first.path / "values" / "c").rglob("*") if path.is_file()):
        damage(chunk)
    lost = r"of values 1 of 1 files are missing or empty; `vt-pipeline run make-noise --check`"
    with pytest.raises(StoreError, match=lost):
        run(request(tmp_path, stage=TakeMean()))
    with pytest.raises(StoreError, match=lost):  # whoever reads it, as trainings do
        published(tmp_path).view("b")["values"]
    (problems,) = (lines for lines in problems_below(tmp_path).values() if lines)
    assert "files are missing or empty" in problems[0]
    assert run(request(tmp_path)) == 5, "up to date means complete"


@pytest.mark.parametrize("array", ["", "values", "label"])
def test_metadata_that_changed_is_refused_and_made_again_as_it_was(tmp_path, array):
    run(request(tmp_path))
    whole = digest(tmp_path)
    metadata = group(tmp_path) / array / "zarr.json"
    metadata.write_text(metadata.read_text().replace('"node_type"', '"node_typ"', 1))
    with pytest.raises(StoreError, match=r"zarr.json differs from what was written; `vt-pipeline run make-noise --check`"):
        published(tmp_path).view("b")[array or "values"]
    assert run(request(tmp_path)) in (0, 5), "a group that cannot be opened is made again"
    run(request(tmp_path, check=True))
    assert digest(tmp_path) == whole
    assert not any(problems_below(tmp_path).values())


def test_an_array_whose_metadata_is_gone_is_not_taken_for_one_that_was_left_out(tmp_path):
    run(request(tmp_path))
    (group(tmp_path) / "label" / "zarr.json").unlink()
    with pytest.raises(StoreError, match=r"label/zarr\.json cannot be read"):
        published(tmp_path).view("b").verify()


def test_check_makes_the_damaged_row_again_and_keeps_the_others(tmp_path):
    run(request(tmp_path))
    whole = digest(tmp_path)
    zarr.open_group(str(group(tmp_path)), mode="r+")["values"][2, 0, 0] = 7.0  # with its checksum: only the row's digest can tell
    assert run(request(tmp_path)) == 0, "not read, not found"
    assert run(request(tmp_path, check=True)) == 1
    assert run(request(tmp_path, check=True)) == 0
    assert digest(tmp_path) == whole
    assert not any(problems_below(tmp_path).values())


def test_nothing_is_learned_from_a_row_that_is_damaged(tmp_path):
    run(request(tmp_path))
    zarr.open_group(str(group(tmp_path)), mode="r+")["values"][2, 0, 0] = 7.0
    stage = Average()
    with pytest.raises(StoreError, match="c is damaged; `vt-pipeline run make-noise --check`"):
        run_plan(plan_of(request(tmp_path, stage)), CONSOLE)
    assert not stage.made
    run(request(tmp_path, check=True))
    run_plan(plan_of(request(tmp_path, stage)), CONSOLE)
    assert stage.made


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


def test_validate_tells_of_a_folder_whose_record_was_deleted(tmp_path):
    run(request(tmp_path))
    run(request(tmp_path, Average()))
    (record := tmp_path / "models" / "average.json").unlink()
    ((path, lines),) = ((path, lines) for path, lines in problems_below(tmp_path).items() if lines)
    assert path == record
    assert "is missing: a run was killed, or it was deleted; run its stage again" in lines[0]
    run(request(tmp_path, Average()))
    assert not any(problems_below(tmp_path).values())


def test_a_record_of_another_format_is_told_from_a_damaged_one(tmp_path):
    run(request(tmp_path))
    record = tmp_path / "noise" / "0000-of-0001.json"
    record.write_text(record.read_text().replace('"format": 2', '"format": 3'))
    with pytest.raises(
        StoreError, match=r"the record is of format 3, this version of vt-pipeline reads format 2; use the version that wrote it"
    ):
        published(tmp_path)


def test_status_says_what_is_damaged_and_tells_the_rest(tmp_path):
    for stage in (MakeNoise(), TakeMean(), Average()):
        run(request(tmp_path, stage))
    flip(tmp_path / "mean" / "0000-of-0001.json")
    account = read_account(tmp_path)
    assert ["mean/0000-of-0001.json: the record is damaged" in line for line in account.damaged] == [True]
    assert [one.artifact for one in account.artifacts] == ["noise"]
    assert [one.folder for one in account.folders] == ["models/average"]
    assert json.loads(account.to_json())["damaged"] == account.damaged


def test_a_record_of_a_shard_that_is_gone_and_folders_in_place_of_files_are_said(tmp_path):
    for stage in (MakeNoise(), TakeMean(), Average()):
        run(request(tmp_path, stage))
    (tmp_path / "mean/0000-of-0001.json").rename(tmp_path / "kept")
    found = problems_below(tmp_path)[tmp_path / "mean/0000-of-0001.json"]
    assert ["the record of 0000-of-0001" in line for line in found] == [True]
    (tmp_path / "kept").rename(tmp_path / "mean/0000-of-0001.json")
    assert not any(problems_below(tmp_path).values())
    made = DataDirectory(tmp_path).folder_path("models/average") / "mean.json"
    for file, said in ((made, "mean.json is missing"), (tmp_path / "models/average.json", "the record of average-")):
        content = file.read_text()
        file.unlink()
        file.mkdir()
        assert any(said in line for lines in problems_below(tmp_path).values() for line in lines)
        file.rmdir()
        file.write_text(content)


def test_status_says_which_file_of_a_folder_is_gone(tmp_path):
    for stage in (MakeNoise(), Average()):
        run(request(tmp_path, stage))
    (DataDirectory(tmp_path).folder_path("models/average") / "mean.json").unlink()
    assert ["average.json: mean.json is missing; run average again" in line for line in read_account(tmp_path).damaged] == [True]


def test_files_that_killed_runs_left_are_garbage(tmp_path):
    run(request(tmp_path))
    left = [tmp_path / "dataset.json.17.tmp", tmp_path / "noise" / "0000-of-0001.json.17.tmp"]
    for path in left:
        path.write_text("half")
    assert collect_everything(DataDirectory(tmp_path), older_than=0) == left


def test_links_are_not_followed_to_remove_garbage(tmp_path):
    data, elsewhere = tmp_path / "data", tmp_path / "elsewhere"
    run(request(data))
    (data / "noise").rename(elsewhere)
    (data / "noise").symlink_to(elsewhere)
    run(request(data, settings={"samples": 9}))  # which collects what was replaced
    others = [elsewhere / "mine.tmp", elsewhere / "photographs-0123456789abcdef" / "one.png"]
    for path in others:
        path.parent.mkdir(exist_ok=True)
        path.write_text("of value")
    (data / "noted.json.17.tmp").symlink_to(others[0])
    (data / "album-0123456789abcdef").symlink_to(others[1].parent)
    groups = sorted(elsewhere.glob("*.zarr"))
    for path in (data, tmp_path / "linked"):
        if path != data:
            path.symlink_to(data)
        done = CliRunner().invoke(app, ["collect-garbage", str(path), "--older-than", "0"])
        assert done.exit_code == 0
        assert f"{path / 'noise'} is a symbolic link: nothing is removed from {elsewhere}" in " ".join(done.output.split())
    assert not list(data.glob("*-0123456789abcdef"))
    assert not list(data.glob("*.tmp"))
    assert all(path.read_text() == "of value" for path in others)
    assert len(groups) == 2
    assert sorted(elsewhere.glob("*.zarr")) == groups


def test_a_number_of_shards_that_no_record_has_is_refused(tmp_path):
    run(request(tmp_path))
    (tmp_path / "dataset.json").write_text('{"shards": 3}')
    with pytest.raises(StoreError, match=r"names 3 shards, but no record has that number; .* as the records are named: 1$"):
        run(request(tmp_path))


def test_without_its_description_a_dataset_is_split_as_its_records_are(tmp_path):
    run(request(tmp_path, shards=2))
    (tmp_path / "dataset.json").unlink()
    assert run(request(tmp_path)) == 0


def test_a_shard_of_another_schema_is_made_again(tmp_path):
    run(request(tmp_path))
    newer = MakeNoise(version=2)
    assert run(request(tmp_path, newer)) == 5
    assert published(tmp_path, newer.output).first.artifact.version == 2


def test_a_damaged_record_does_not_keep_its_own_stage_from_making_it_again(tmp_path):
    run(request(tmp_path))
    whole = digest(tmp_path)
    flip(tmp_path / "noise" / "0000-of-0001.json")
    assert run(request(tmp_path)) == 5
    assert digest(tmp_path) == whole
