"""Dataset stages: run once, skipped, made again when anything they depend on changes, and never half there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pipeline.engine.run import run as run_plan
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError, StoreError
from pipeline.reports.status import read_account
from pipeline.store.directory import DataDirectory
from pipeline.store.origins import check_origins
from pipeline.store.record import FolderRecord, serialise_with_checksum
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import CONSOLE, Average, objects, plan_of, request, run

RECORD = Path("models/average.json")


def make(data: Path, stage: Average | None = None, **changes: Any) -> bool:
    """Run it; whether it made anything."""
    stage = stage or Average()
    run_plan(plan_of(request(data, stage, **changes)), CONSOLE)
    return stage.made > 0


def record(data: Path) -> FolderRecord:
    return DataDirectory(data).folder("models/average")


def test_it_is_made_once_and_recorded(tmp_path):
    run(request(tmp_path))
    assert make(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert not make(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    made = record(tmp_path)
    assert (made.stage, set(made.files), made.facts) == ("average", {"mean.json"}, {"resumed": False})
    assert problems_below(tmp_path)[tmp_path / RECORD] == []


def test_objects_that_failed_are_not_counted(tmp_path):
    items = objects(3, b="bad")
    run(request(tmp_path, items=items))
    assert plan_of(request(tmp_path, Average(), items=items)).total == 2
    other = objects(1, a="bad")
    run(request(tmp_path / "other", items=other))
    with pytest.raises(StoreError, match=r"average: all 1 objects in split train failed; see `vt-pipeline status"):
        plan_of(request(tmp_path / "other", Average(), items=other))


def test_settings_seed_and_rows_of_its_splits_make_it_again_others_do_not(tmp_path):
    items = [*objects(3), *[item for item in objects(5, split="test") if item.object_id in "de"]]
    run(request(tmp_path, items=items))
    assert make(tmp_path, items=items)
    assert make(tmp_path, items=items, settings={"samples": 49})
    assert make(tmp_path, items=items)
    assert not make(tmp_path, items=items, settings={"batch": 9}), "a setting that only changes speed"
    assert make(tmp_path, items=items, seed=1)
    assert make(tmp_path, items=items)
    run(request(tmp_path, items=[*items[:3], *[item for item in objects(5, kind="other", split="test") if item.object_id in "de"]]))
    assert not make(tmp_path, items=items), "test objects are not looked at"
    run(request(tmp_path, items=[*objects(3, kind="other"), *items[3:]]))
    assert make(tmp_path, items=items)


def test_what_a_failed_run_left_is_continued_and_nothing_is_published_meanwhile(tmp_path):
    run(request(tmp_path))
    with pytest.raises(StageError, match="no more"):
        make(tmp_path, Average(dies=True))
    assert not (tmp_path / RECORD).exists()
    assert make(tmp_path)
    assert record(tmp_path).facts == {"resumed": True}
    assert not list((tmp_path / ".work/models/average").glob("*/"))


def test_what_was_finished_but_not_published_is_not_made_again(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    plan = plan_of(request(tmp_path, Average()))
    folder, work = DataDirectory(tmp_path).folder_path("models/average"), DataDirectory(tmp_path).work("models/average") / plan.key[:16]

    def unpublish() -> None:
        work.with_suffix(".json").write_bytes(serialise_with_checksum(record(tmp_path)))
        (tmp_path / RECORD).unlink()
        folder.rename(work)

    unpublish()
    assert not make(tmp_path)
    assert (folder / "mean.json").exists()
    unpublish()
    work.rename(folder)  # and killed before its record was there
    assert not make(tmp_path)
    assert record(tmp_path).location == folder.name
    assert not list(work.parent.glob("*/"))
    unpublish()
    (work / "mean.json").write_text("[]")
    assert make(tmp_path), "it is not what was written"


def test_hidden_files_are_kept_until_a_folder_is_finished_and_belong_to_none(tmp_path, monkeypatch):
    class Learns(Average):
        def make(self, job: DatasetJob) -> dict[str, Any]:
            (job.folder / ".checkpoint").write_text("all that was learned")
            return super().make(job)

    def killed(folder: Path) -> None:
        raise KeyboardInterrupt

    run(request(tmp_path))
    with monkeypatch.context() as during:
        during.setattr("pipeline.engine.folder.hashes_of", killed)
        with pytest.raises(KeyboardInterrupt):
            make(tmp_path, Learns())
    assert list(tmp_path.glob(".work/models/average/*/.checkpoint"))
    assert make(tmp_path, Learns())
    assert set(record(tmp_path).files) == {"mean.json"}
    assert not list(tmp_path.rglob(".checkpoint"))


def test_a_file_that_was_deleted_is_made_again(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    (DataDirectory(tmp_path).folder_path("models/average") / "mean.json").unlink()
    assert make(tmp_path), "up to date means complete"


def test_an_input_that_is_not_there_is_an_error_that_says_so(tmp_path):
    with pytest.raises(StoreError, match="noise has not been made"):
        make(tmp_path)
    run(request(tmp_path))
    with pytest.raises(StoreError, match="no object in split train"):
        make(tmp_path, items=objects(5, split="valid"))
    with pytest.raises(StoreError, match=r"models/average has not been made; run `vt-pipeline run train-average` first"):
        make(tmp_path, Average(reads=("models/average",)))
    further = "vt-pipeline run train-gcn --set train-gcn.configuration=touch --set train-gcn.training_seed=1"
    with pytest.raises(StoreError, match=rf"models/seed-1/gcn/touch has not been made; run `{further}` first"):
        make(tmp_path, Average(reads=("models/seed-1/gcn/touch",)))


def test_a_manifest_that_has_changed_since_the_objects_were_made_is_refused(tmp_path):
    run(request(tmp_path))
    fewer, moved = objects(4), [*objects(4), *objects(5, split="test")[4:]]
    for items, now in ((fewer, "not there"), (moved, "in split test")):
        with pytest.raises(StoreError, match=rf"has e in split train, in manifest tiny it is {now}; run `vt-pipeline run make-noise`"):
            make(tmp_path, items=items)
    assert run(request(tmp_path, items=moved)) == 0
    assert make(tmp_path, items=moved)
    with pytest.raises(StoreError, match="has e in split test, in manifest tiny it is in split train"):
        make(tmp_path, items=objects(5))


def test_a_model_made_from_what_has_changed_since_is_refused_and_reported(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    assert make(tmp_path, Average(reads=("models/average",)))
    assert not make(tmp_path, Average(reads=("models/average",)))
    run(request(tmp_path, seed=1))
    with pytest.raises(StoreError, match=r"made from other noise than the current ones; run average again"):
        check_origins(DataDirectory(tmp_path), ["models/average"])
    with pytest.raises(StoreError, match="run average again"):
        make(tmp_path, Average(reads=("models/average",)))
    assert all("run average again" in str(folder.stale) for folder in read_account(tmp_path).folders)
    make(tmp_path)
    assert make(tmp_path, Average(reads=("models/average",)))
    assert [folder.stale for folder in read_account(tmp_path).folders] == [None, None]


@pytest.mark.parametrize(("name", "maker"), [("shipped", "report --shipped"), ("theirs", "score")])
def test_an_outdated_score_names_the_command_that_makes_it(tmp_path, name, maker):
    run(request(tmp_path))
    make(tmp_path)
    outdated = record(tmp_path).model_copy(update={"inputs": {"noise": "0" * 64}, "stage": "evaluate-shipped"})
    (tmp_path / "scores").mkdir()
    (tmp_path / f"scores/{name}.json").write_bytes(serialise_with_checksum(outdated))
    with pytest.raises(StoreError, match=f"made from other noise than the current ones; run `vt-pipeline {maker}` again"):
        check_origins(DataDirectory(tmp_path), [f"scores/{name}"])


def test_a_changed_or_missing_file_is_found(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    file = DataDirectory(tmp_path).folder_path("models/average") / "mean.json"
    file.write_text("[]")
    assert "mean.json differs from what was written; delete" in problems_below(tmp_path)[tmp_path / RECORD][0]
    file.unlink()
    assert "mean.json is missing; delete" in problems_below(tmp_path)[tmp_path / RECORD][0]


def test_two_runs_of_one_folder_do_not_meet(tmp_path):
    run(request(tmp_path))

    class Nested(Average):
        def make(self, job: DatasetJob) -> dict[str, Any]:
            with pytest.raises(StoreError, match="is being made by another run"):
                make(tmp_path)
            return super().make(job)

    assert make(tmp_path, Nested())


def test_a_record_that_names_an_artifact_nobody_knows_is_refused(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    foreign = record(tmp_path).model_copy(update={"inputs": {"passwords": "0" * 64}})
    (tmp_path / RECORD).write_bytes(serialise_with_checksum(foreign))
    with pytest.raises(StoreError, match="there is no artifact passwords; delete the record and run average again"):
        check_origins(DataDirectory(tmp_path), ["models/average"])
