"""Dataset stages run once, are skipped when up to date, run again when a dependency changes, and publish whole folders only."""

from pathlib import Path
from typing import Any

import pytest

from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError, StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.record import FolderRecord, serialise_with_checksum
from pipeline.store.validate import check_origins, problems_below
from pipeline.tables.status import read_account
from tests.engine.tiny_stages import CONSOLE, Average, objects, plan_of, request, run

RECORD = Path("models/average.json")


def make(data: Path, stage: Average | None = None, **changes: Any) -> bool:
    """Run a stage; return whether it made anything."""
    stage = stage or Average()
    plan_of(request(data, stage, **changes)).make(CONSOLE)
    return stage.made > 0


def record(data: Path) -> FolderRecord:
    return DataDirectory(data).folder("models/average")


def test_folder_is_made_once_and_recorded(tmp_path):
    run(request(tmp_path))
    assert make(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert not make(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    folder_record = record(tmp_path)
    assert (folder_record.stage, set(folder_record.files), folder_record.facts) == ("average", {"mean.json"}, {"resumed": False})
    assert problems_below(tmp_path)[tmp_path / RECORD] == []


def test_objects_that_failed_are_not_counted(tmp_path):
    items = objects(3, b="bad")
    run(request(tmp_path, items=items))
    assert plan_of(request(tmp_path, Average(), items=items)).total == 2
    other = objects(1, a="bad")
    run(request(tmp_path / "an other", items=other))
    with pytest.raises(StoreError, match=r"average: all 1 objects in split train failed; see `vt-pipeline status '.*/an other'`"):
        plan_of(request(tmp_path / "an other", Average(), items=other))


def test_folder_is_made_again_for_changed_settings_seed_or_rows_of_its_splits_only(tmp_path):
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


def test_failed_run_publishes_nothing_and_is_continued(tmp_path):
    run(request(tmp_path))
    with pytest.raises(StageError, match="no more"):
        make(tmp_path, Average(dies=True))
    assert not (tmp_path / RECORD).exists()
    assert make(tmp_path)
    assert record(tmp_path).facts == {"resumed": True}
    assert not list((tmp_path / ".work/models/average").glob("*/"))


def test_finished_unpublished_folder_is_published_without_computing(tmp_path):
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
    work.rename(folder)  # as if killed before the record was written
    assert not make(tmp_path)
    assert record(tmp_path).location == folder.name
    assert not list(work.parent.glob("*/"))
    unpublish()
    (work / "mean.json").write_text("[]")
    assert make(tmp_path), "it is not what was written"


def test_hidden_files_are_kept_until_a_folder_is_finished_and_are_not_published(tmp_path, monkeypatch):
    class Learns(Average):
        def make(self, job: DatasetJob) -> dict[str, Any]:
            (job.folder / ".checkpoint").write_text("all that was learned")
            return super().make(job)

    def killed(folder: Path) -> None:
        raise KeyboardInterrupt

    run(request(tmp_path))
    with monkeypatch.context() as during:
        during.setattr("pipeline.engine.folder_plan.hashes_of", killed)
        with pytest.raises(KeyboardInterrupt):
            make(tmp_path, Learns())
    assert list(tmp_path.glob(".work/models/average/*/.checkpoint"))
    assert make(tmp_path, Learns())
    assert set(record(tmp_path).files) == {"mean.json"}
    assert not list(tmp_path.rglob(".checkpoint"))


def test_missing_input_is_named_with_the_command_that_makes_it(tmp_path):
    with pytest.raises(StoreError, match="noise has not been made"):
        make(tmp_path)
    run(request(tmp_path))
    with pytest.raises(StoreError, match="no object in split train"):
        make(tmp_path, items=objects(5, split="valid"))
    with pytest.raises(StoreError, match=r"models/average has not been made; run `vt-pipeline run train-average --data .*` first"):
        make(tmp_path, Average(trained=("models/average",)))
    further = "vt-pipeline run train-gcn --data .* --set train-gcn.configuration=touch --set train-gcn.training_seed=1"
    with pytest.raises(StoreError, match=rf"models/seed-1/gcn/touch has not been made; run `{further}` first"):
        make(tmp_path, Average(trained=("models/seed-1/gcn/touch",)))


def test_manifest_that_differs_from_the_rows_is_refused(tmp_path):
    run(request(tmp_path))
    fewer, moved = objects(4), [*objects(4), *objects(5, split="test")[4:]]
    for items, now in ((fewer, "not there"), (moved, "in split test")):
        with pytest.raises(StoreError, match=rf"has e in split train, in manifest tiny it is {now}; run `vt-pipeline run make-noise`"):
            make(tmp_path, items=items)
    assert run(request(tmp_path, items=moved)) == 0
    assert make(tmp_path, items=moved)
    with pytest.raises(StoreError, match="has e in split test, in manifest tiny it is in split train"):
        make(tmp_path, items=objects(5))


def test_model_of_outdated_inputs_is_refused_and_reported_by_status(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    assert make(tmp_path, Average(trained=("models/average",)))
    assert not make(tmp_path, Average(trained=("models/average",)))
    run(request(tmp_path, seed=1))
    with pytest.raises(StoreError, match=r"made from other noise than the current ones; run average again"):
        check_origins(DataDirectory(tmp_path), ["models/average"])
    with pytest.raises(StoreError, match="run average again"):
        make(tmp_path, Average(trained=("models/average",)))
    assert all("run average again" in str(folder.stale) for folder in read_account(tmp_path).folders)
    make(tmp_path)
    assert make(tmp_path, Average(trained=("models/average",)))
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


def test_changed_or_missing_file_is_reported(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    file = DataDirectory(tmp_path).folder_path("models/average") / "mean.json"
    file.write_text("[]")
    assert "mean.json differs from what was written; delete" in problems_below(tmp_path)[tmp_path / RECORD][0]
    file.unlink()
    assert "mean.json is missing; delete" in problems_below(tmp_path)[tmp_path / RECORD][0]
    assert make(tmp_path), "up to date means complete"


def test_second_run_of_a_folder_is_refused_while_the_first_is_at_work(tmp_path):
    run(request(tmp_path))

    class Nested(Average):
        def make(self, job: DatasetJob) -> dict[str, Any]:
            with pytest.raises(StoreError, match="is being made by another run"):
                make(tmp_path)
            return super().make(job)

    assert make(tmp_path, Nested())


def test_record_of_an_unknown_artifact_is_refused(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    foreign = record(tmp_path).model_copy(update={"inputs": {"passwords": "0" * 64}})
    (tmp_path / RECORD).write_bytes(serialise_with_checksum(foreign))
    with pytest.raises(StoreError, match="there is no artifact passwords; delete the record and run average again"):
        check_origins(DataDirectory(tmp_path), ["models/average"])
