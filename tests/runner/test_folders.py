"""Set stages: run once, skipped, made anew when anything they stand on changes, and never half there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pipeline.engine.folders import fill, plan_folder

from pipeline.console import console_on
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError, StoreError
from pipeline.reports.status import read_folders
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Record, standing_record
from pipeline.store.validate import problems_below
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS
from tests.runner.tiny import NOISE, NoiseSettings, objects, request, run


@pytest.fixture(autouse=True)
def known_noise(monkeypatch):
    monkeypatch.setitem(ARTIFACTS, "noise", NOISE)


class Average:
    """The mean over all training objects, into a file; `dies` leaves its folder half done."""

    name = "average"
    summary = "average them all"
    settings_type = NoiseSettings

    def __init__(self, dies: bool = False, reads: tuple[str, ...] = ()) -> None:
        self.dies, self.reads = dies, reads
        self.made = 0

    def inputs(self, settings: NoiseSettings) -> tuple[Artifact, ...]:
        return (NOISE,)

    def models(self, settings: NoiseSettings) -> tuple[str, ...]:
        return self.reads

    def splits(self, settings: NoiseSettings) -> tuple[str, ...]:
        return ("train",)

    def folder(self, settings: NoiseSettings) -> str:
        return "models/second" if self.reads else "models/average"

    def grid(self, settings: NoiseSettings) -> dict[str, Any]:
        return {}

    def make(self, job: DatasetJob) -> dict[str, Any]:
        self.made += 1
        begun = job.folder / "begun"
        if self.dies:
            begun.write_text("half")
            raise StageError("no more")
        found = DataDirectory(job.data).collection(NOISE)
        means = [float(found.view(name)["values"].mean()) for name in found if found.shard(name).split(name) == "train"]
        facts = {"resumed": begun.exists()}
        begun.unlink(missing_ok=True)
        (job.folder / "mean.json").write_text(json.dumps(means))
        return facts


def make(data: Path, stage: Average | None = None, **changes: Any) -> bool:
    """Run it unless it is up to date; whether it ran."""
    stage = stage or Average()
    plan = plan_folder(request(data, stage, **changes))
    if not plan.up_to_date():
        fill(plan, console_on(__import__("sys").stdout))
    return stage.made > 0


def test_it_is_made_once_and_recorded(tmp_path):
    run(request(tmp_path))
    assert make(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert not make(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    content = Record(tmp_path / "models/average").content
    assert content["stage"] == "average"
    assert set(content["files"]) == {"mean.json"}
    assert content["facts"] == {"resumed": False}
    assert problems_below(tmp_path)[tmp_path / "models/average"] == []


def test_settings_seed_and_rows_of_its_splits_make_it_anew_others_do_not(tmp_path):
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


def test_what_a_failed_run_left_is_gone_on_with_and_nothing_stands_meanwhile(tmp_path):
    run(request(tmp_path))
    with pytest.raises(StageError, match="no more"):
        make(tmp_path, Average(dies=True))
    assert not (tmp_path / "models").exists()
    assert make(tmp_path)
    assert Record(tmp_path / "models/average").content["facts"] == {"resumed": True}
    assert not list((tmp_path / ".work/models/average").glob("*/"))


def test_what_was_finished_but_not_put_in_place_is_not_made_again(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    folder, work = tmp_path / "models/average", plan_folder(request(tmp_path, Average())).work
    work.parent.mkdir(parents=True, exist_ok=True)
    folder.rename(work)
    stage = Average()
    assert not make(tmp_path, stage)
    assert (folder / "mean.json").exists()
    folder.rename(work)
    (work / "mean.json").write_text("[]")
    assert make(tmp_path), "it is not what was written"


def test_an_input_that_is_not_there_is_an_error_that_says_so(tmp_path):
    with pytest.raises(StoreError, match="has no object a"):
        make(tmp_path)
    run(request(tmp_path))
    with pytest.raises(StoreError, match="no object in split train"):
        make(tmp_path, items=objects(5, split="valid"))
    with pytest.raises(StoreError, match=r"models/average is not there.*run the stage that fills it first"):
        make(tmp_path, Average(reads=("models/average",)))


def test_a_model_made_from_what_has_changed_since_is_refused_and_reported(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    assert make(tmp_path, Average(reads=("models/average",)))
    assert not make(tmp_path, Average(reads=("models/average",)))
    run(request(tmp_path, seed=1))
    with pytest.raises(StoreError, match=r"made from other noise than stand in .* now; run average again"):
        standing_record(Layout(tmp_path), "models/average")
    with pytest.raises(StoreError, match="run average again"):
        make(tmp_path, Average(reads=("models/average",)))
    assert all("run average again" in str(account.stale) for account in read_folders(tmp_path))
    make(tmp_path)
    assert make(tmp_path, Average(reads=("models/average",)))
    assert [account.stale for account in read_folders(tmp_path)] == [None, None]


def test_a_changed_or_missing_file_is_found(tmp_path):
    run(request(tmp_path))
    make(tmp_path)
    folder = tmp_path / "models/average"
    (folder / "mean.json").write_text("[]")
    assert problems_below(tmp_path)[folder] == ["mean.json differs from what was written (digest)"]
    (folder / "mean.json").unlink()
    assert problems_below(tmp_path)[folder] == ["mean.json is missing"]


def test_two_runs_of_one_folder_do_not_meet(tmp_path):
    run(request(tmp_path))

    class Nested(Average):
        def make(self, job: DatasetJob) -> dict[str, Any]:
            with pytest.raises(StoreError, match="is being made by another run"):
                make(tmp_path)
            return super().make(job)

    assert make(tmp_path, Nested())
