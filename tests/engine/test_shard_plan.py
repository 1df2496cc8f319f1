"""Object stages: skipped, resumed, split into shards, run by workers."""

import errno
import os
import re
import shutil
import threading
from pathlib import Path
from unittest.mock import Mock, patch

import numpy as np
import pytest

from pipeline.config.sources import Object
from pipeline.dataset.labelled import open_artifact
from pipeline.engine.executor import Serial
from pipeline.engine.make import make, plans
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.formats.description_file import description_path
from pipeline.rng import numpy_rng
from pipeline.store import directory as directory_module
from pipeline.store.atomic import exclusive_lock
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from pipeline.store.record import read_record
from pipeline.store.validate import check_origins, problems_below
from pipeline.tables.status import read_account
from tests.engine.tiny_stages import (
    CONSOLE,
    MEAN,
    Average,
    Compare,
    Halve,
    MakeNoise,
    TakeMean,
    digest,
    objects,
    plan_of,
    published,
    request,
    run,
)


def stamps(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


def test_a_second_run_does_nothing_and_touches_no_file(tmp_path):
    assert run(request(tmp_path)) == 5
    before = stamps(tmp_path)
    assert run(request(tmp_path)) == 0
    assert stamps(tmp_path) == before


def test_settings_that_change_results_make_rows_again_and_speed_settings_do_not(tmp_path):
    run(request(tmp_path))
    assert run(request(tmp_path, settings={"batch": 3})) == 0
    assert run(request(tmp_path, settings={"samples": 51})) == 5
    assert run(request(tmp_path, stage=TakeMean())) == 5
    assert run(request(tmp_path, stage=TakeMean(), settings={"samples": 3})) == 5


@pytest.mark.parametrize(("shards", "workers"), [pytest.param(4, 1, marks=pytest.mark.slow), (7, 2)])
def test_digest_does_not_depend_on_shards_or_workers(tmp_path, shards, workers):
    for data, options in ((tmp_path / "one", {}), (tmp_path / "other", {"shards": shards, "executor": WorkerProcesses(workers)})):
        run(request(data, **options))
        run(request(data, stage=TakeMean(), **options))
    assert digest(tmp_path / "one") == digest(tmp_path / "other")
    assert digest(tmp_path / "one", MEAN) == digest(tmp_path / "other", MEAN)


class StopsAfterTwo(Serial):
    def run(self, work, units):
        results = super().run(work, units)
        yield next(results)
        yield next(results)
        raise KeyboardInterrupt


def test_interrupted_run_is_continued(tmp_path):
    run(request(tmp_path / "whole"))
    with pytest.raises(KeyboardInterrupt):
        run(request(tmp_path / "cut", executor=StopsAfterTwo()))
    plan = plan_of(request(tmp_path / "cut"))
    assert plan.shard is None
    assert plan.estimate()[0] == 3
    assert run(request(tmp_path / "cut")) == 3
    assert digest(tmp_path / "cut") == digest(tmp_path / "whole")


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"manifest": "other"},
        {"stage": MakeNoise(version=2)},
        {"stage": MakeNoise(asset="another")},
        {"items": objects(5, kind="digit")},
    ],
    ids=["seed", "manifest", "schema", "asset", "category"],
)
def test_key_depends_on_everything_that_decides_the_output(tmp_path, change):
    before, after = (plan_of(request(tmp_path, **options)) for options in ({}, change))
    assert before.key != after.key


def test_origins_of_an_input_are_checked(tmp_path):
    run(request(tmp_path))
    run(request(tmp_path, stage=TakeMean()))
    assert run(request(tmp_path, stage=Halve())) == 5
    check_origins(DataDirectory(tmp_path), ["mean"])
    run(request(tmp_path, settings={"samples": 7}))
    with pytest.raises(StoreError, match="mean of a was made from other noise than the current ones; run take-mean again"):
        plan_of(request(tmp_path, stage=Halve()))
    with pytest.raises(StoreError, match="mean of a was made from other noise than the current ones; run take-mean again"):
        check_origins(DataDirectory(tmp_path), ["mean"])
    with pytest.raises(StoreError, match="mean of a was made from other noise than the current ones; run take-mean again"):
        plan_of(request(tmp_path, stage=Compare()))
    assert "was made from other noise" in problems_below(tmp_path)[tmp_path / "mean"][0]
    shutil.rmtree(tmp_path / "noise")  # deleted to save space: there is nothing to compare with
    plan_of(request(tmp_path, stage=Halve()))


def test_shard_needs_only_its_own_shard_of_the_inputs(tmp_path):
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path, stage=stage, shards=2))
    for shard in (0, 1):  # `make` takes each shard through all stages
        for stage in (MakeNoise(), TakeMean()):
            assert run(request(tmp_path, stage=stage, settings={"samples": 7}), shard)
    assert not any(problems_below(tmp_path).values())


def test_shards_with_different_settings_are_refused_until_all_are_made_again(tmp_path):
    for settings in ({}, {"samples": 7}):
        for stage in (MakeNoise(), TakeMean()):
            run(request(tmp_path, stage=stage, settings=settings, shards=2), 0 if settings else None)
    expected = "noise: its shards 0000-of-0002 and 0001-of-0002 were made with different settings (samples 7 and 50); "
    with pytest.raises(StoreError, match=re.escape(f"{expected}run `vt-pipeline run make-noise --data {tmp_path}` for all shards")):
        open_artifact(tmp_path, "noise")
    with pytest.raises(StoreError, match="different settings"):
        plan_of(request(tmp_path, stage=Average()))
    assert [expected in line for line in problems_below(tmp_path)[tmp_path / "noise"]] == [True]
    assert [expected in str(artifact.stale) for artifact in read_account(tmp_path).artifacts] == [True, False]
    run(request(tmp_path, settings={"samples": 7}), 1)
    with pytest.raises(StoreError, match=r"mean: its shards .* different settings"):
        check_origins(DataDirectory(tmp_path), ["mean"])
    run(request(tmp_path, stage=TakeMean(), settings={"samples": 7}), 1)
    assert not any(problems_below(tmp_path).values())
    run(request(tmp_path, settings={"samples": 7}, seed=1), 0)
    with pytest.raises(StoreError, match=r"different settings .--seed 1 and 0."):
        check_origins(DataDirectory(tmp_path), ["noise"])


def test_another_number_of_shards_is_refused_with_a_remedy(tmp_path):
    run(request(tmp_path, shards=2))
    with pytest.raises(StoreError, match=r"is split into 2 shards, 4 were asked for; .* --data FOLDER --reuse .* copies its rows"):
        run(request(tmp_path, shards=4))
    assert run(request(tmp_path)) == 0, "without --shards, the dataset's number"


def test_dataset_in_another_number_of_shards_reuses_the_rows_of_another_directory(tmp_path):
    items = objects(5, b="bad")
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path / "two", stage=stage, items=items, shards=2))
        four = request(tmp_path / "four", stage=stage, items=items, shards=4, reuse=tmp_path / "two")
        made = make(four, CONSOLE)
        assert [answer.objects for answer in made] == [0] * 4
        assert sum(int(re.match(r"reused (\d)|", answer.text)[1] or 0) for answer in made) == 4
    assert digest(tmp_path / "four") == digest(tmp_path / "two")
    assert digest(tmp_path / "four", MEAN) == digest(tmp_path / "two", MEAN)
    assert run(request(tmp_path / "other", settings={"samples": 9}, reuse=tmp_path / "two")) == 5, "rows with other keys are made"


def test_changed_labels_of_an_input_are_copied_without_computing(tmp_path):
    for stage in (MakeNoise(), TakeMean(), MakeNoise(asset="finger")):
        run(request(tmp_path, stage=stage))
    assert published(tmp_path, MEAN).first.read("sensor").tolist() == ["thumb"]
    assert run(request(tmp_path, stage=TakeMean())) == 0
    assert published(tmp_path, MEAN).first.read("sensor").tolist() == ["finger"]
    assert plan_of(request(tmp_path, stage=TakeMean())).up_to_date()


@pytest.mark.parametrize("moment", ["session", "constants"])
def test_hand_or_sensor_file_that_changes_during_a_run_is_refused(tmp_path, monkeypatch, moment):
    stage, file = MakeNoise(), tmp_path / "sensor.yaml"
    file.write_text("old")
    monkeypatch.setattr(stage, "assets", lambda settings: [file])
    read = getattr(stage, moment)
    with monkeypatch.context() as edited:
        edited.setattr(stage, moment, lambda *given: (file.write_text("new"), read(*given))[1])
        with pytest.raises(StageError, match=r"a file that make-noise reads .* changed meanwhile; run again"):
            run(request(tmp_path / "data", stage=stage))
    assert not len(published(tmp_path / "data"))
    assert run(request(tmp_path / "data", stage=stage)) == 5


def test_object_whose_file_changes_during_a_run_is_made_again(tmp_path, monkeypatch):
    stage, file = MakeNoise(), tmp_path / "b.stl"
    file.write_text("old")
    items = [*objects(1), Object("b", "letter", {"file": str(file), "root": str(tmp_path)}, "train")]
    read = stage.session
    with monkeypatch.context() as edited:
        edited.setattr(stage, "session", lambda *given: (file.write_text("new"), read(*given))[1])
        with pytest.raises(StageError, match="make-noise: files of b changed meanwhile; run again"):
            run(request(tmp_path / "data", stage=stage, items=items))
    assert run(request(tmp_path / "data", stage=stage, items=items)) == 1


def test_data_directory_that_may_not_be_written_to_is_named(tmp_path, monkeypatch):
    run(request(tmp_path))
    plan = plan_of(request(tmp_path, settings={"samples": 7}))
    for path in (plan.lock, plan.lock.parent):  # root may write anywhere
        monkeypatch.setattr(
            "pipeline.engine.plan.exclusive_lock", Mock(side_effect=PermissionError(errno.EACCES, "Permission denied", path))
        )
        with pytest.raises(StoreError, match=r"cannot be written: Permission denied; make .* writable, then run again"):
            plan.make(CONSOLE)


def test_data_directory_of_other_objects_is_not_overwritten(tmp_path):
    run(request(tmp_path))
    x = Object("x", "letter", {"trouble": None, "name": "x"}, "train")
    before = stamps(tmp_path / "noise")
    with pytest.raises(StoreError, match=r"holds other objects \(a, b, c, d, e\), and none of manifest tiny; name another --data"):
        run(request(tmp_path, items=[x]))
    assert stamps(tmp_path / "noise") == before
    assert run(request(tmp_path, items=[*objects(1), x])) == 1, "a manifest that changes keeps the rows that it still names"


def test_missing_description_file_ends_a_dry_run(tmp_path):
    with (
        patch.object(MakeNoise, "assets", lambda *_: [description_path("sensor", "nope.yaml")]),
        pytest.raises(StageError, match=r"make-noise: there is no sensor 'nope\.yaml'; built in are"),
    ):
        make(request(tmp_path), CONSOLE, dry_run=True)


def test_dry_run_forecasts_the_chosen_shard(tmp_path):
    mean_request = request(tmp_path, stage=TakeMean(), shards=5)
    foreseen = make(mean_request, CONSOLE, dry_run=True)
    assert [shard.objects for shard in foreseen] == [3, 0, 0, 1, 1], "before its inputs have been made"
    assert foreseen[0].text.startswith("would make 3 of 3 objects")
    assert [shard.objects for shard in make(mean_request, CONSOLE, 0, dry_run=True)] == [3]
    with pytest.raises(StoreError, match="there is no shard 9 of 5"):
        make(mean_request, CONSOLE, 9, dry_run=True)


def test_a_shard_without_objects_needs_no_inputs(tmp_path):
    """Shards 1 and 2 of 5 hold none of a to e; they run before any input has been made."""
    mean_request = request(tmp_path, stage=TakeMean(), shards=5)
    assert [run(mean_request, shard) for shard in (1, 2)] == [0, 0]
    with pytest.raises(StoreError, match="noise has not been made"):
        run(mean_request, 4)


def test_shard_without_remaining_objects_is_withdrawn(tmp_path):
    """The second of 4 shards holds b alone."""
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path, stage=stage, shards=4))
    assert "b" in published(tmp_path)
    remaining = [item for item in objects(5) if item.object_id != "b"]
    (foreseen,) = make(request(tmp_path, items=remaining, shards=4), CONSOLE, 1, dry_run=True)
    assert foreseen.text == "would be removed, all its objects have left the manifest"
    for stage in (MakeNoise(), TakeMean()):
        assert run(request(tmp_path, stage=stage, items=remaining, shards=4)) == 0
    assert sorted(published(tmp_path)) == sorted(published(tmp_path, MEAN)) == list("acde")
    assert len(list((tmp_path / "noise").glob("0001-of-0004-*.zarr"))) == 1, "kept for its readers"
    assert not any(lines for lines in problems_below(tmp_path).values())


def test_objects_of_another_manifest_are_not_dropped(tmp_path):
    run(request(tmp_path))
    for function in (run, lambda asked: make(asked, CONSOLE, dry_run=True)):
        with pytest.raises(InvalidInput, match=r"is of manifest tiny; other lacks 2 objects of it \(d, e\); name that --manifest"):
            function(request(tmp_path, items=objects(3), manifest="other"))
    assert list(published(tmp_path)) == list("abcde")
    assert run(request(tmp_path, items=objects(7), manifest="other")) == 2, "one that has more takes over"


def test_records_of_inputs_are_read_once_for_all_shards(tmp_path, monkeypatch):
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path, stage, shards=3))
    inputs = sorted(path.name for path in DataDirectory(tmp_path).shard_records("noise"))
    read: list[str] = []
    monkeypatch.setattr(directory_module, "read_record", lambda path, kind: read.append(path.name) or read_record(path, kind))
    assert run(request(tmp_path, TakeMean(), shards=3)) == 0
    assert sorted(read) == inputs


def test_inputs_that_change_between_two_shards_are_noticed(tmp_path):
    run(request(tmp_path, shards=3))
    planned = plans(request(tmp_path, TakeMean(), shards=3))
    next(planned).make(CONSOLE)
    run(request(tmp_path, shards=3, settings={"samples": 9}))
    with pytest.raises(StoreError, match="was replaced meanwhile; run again"):
        [plan.make(CONSOLE) for plan in planned]
    assert run(request(tmp_path, TakeMean(), shards=3, settings={"samples": 9})) == 5


def test_replaced_group_is_collected_and_the_recorded_group_is_kept(tmp_path):
    run(request(tmp_path))
    old = published(tmp_path).first.path
    os.utime(old, (0, 0))  # the time of the replacement counts, not that of writing
    run(request(tmp_path, settings={"samples": 9}))
    new = published(tmp_path).first.path
    assert old.exists(), "readers may still use it"
    assert collect_everything(DataDirectory(tmp_path)) == []
    assert collect_everything(DataDirectory(tmp_path), older_than=0) == [old]
    assert new.exists()
    assert not any(problems_below(tmp_path).values())


def test_changed_split_is_published_without_computing(tmp_path):
    run(request(tmp_path))
    whole = digest(tmp_path)
    assert run(request(tmp_path, items=objects(5, split="test"))) == 0
    assert published(tmp_path).row("c").split == "test"
    assert digest(tmp_path) != whole


def test_inputs_with_different_splits_are_refused(tmp_path):
    for stage, split in ((MakeNoise(), "train"), (TakeMean(), "train"), (MakeNoise(), "test")):
        run(request(tmp_path, stage=stage, items=objects(5, split=split)))
    other = (
        "mean/0000-of-0001.* has other splits than noise: a is train in mean and test there; run make-noise and take-mean again with one"
    )
    with pytest.raises(StoreError, match=other):
        plan_of(request(tmp_path, stage=Compare()))
    assert run(request(tmp_path, stage=TakeMean(), items=objects(5, split="test"))) == 0
    assert run(request(tmp_path, stage=Compare(), items=objects(5, split="test"))) == 5


def test_missing_input_is_named(tmp_path):
    with pytest.raises(StoreError, match=r"noise has not been made; run `vt-pipeline run STAGE --data .*` first"):
        plan_of(request(tmp_path, stage=TakeMean()))
    run(request(tmp_path, items=objects(1)))
    with pytest.raises(StoreError, match=r"noise, of manifest tiny, has no object b; .* run `vt-pipeline run make-noise --data .*` first"):
        plan_of(request(tmp_path, stage=TakeMean()))


def test_second_run_of_a_shard_is_refused_while_the_first_is_at_work(tmp_path):
    held, free = threading.Event(), threading.Event()

    def hold() -> None:
        with exclusive_lock(plan_of(request(tmp_path)).lock, tmp_path):
            held.set()
            free.wait(30)

    other = threading.Thread(target=hold)
    other.start()
    assert held.wait(30)
    with pytest.raises(StoreError, match="is being made by another run"):
        run(request(tmp_path))
    free.set()
    other.join()
    assert run(request(tmp_path)) == 5


def test_seeds_are_keyed_by_identity():
    draws = {numpy_rng(*identity).random() for identity in [(0, "a", "b"), (0, "ab"), (0, "a", "b", 1), (1, "a", "b"), (0, "b", "a")]}
    assert len(draws) == 5
    assert numpy_rng(0, "a", 1).random() == numpy_rng(0, "a", 1).random()


def test_rows_can_be_read_back(tmp_path):
    run(request(tmp_path))
    view = published(tmp_path).view("c")
    assert str(view["label"]) == "letter"
    assert view["values"].dtype == np.float32
    np.testing.assert_array_equal(view["lists/numbers"], [1])
    np.testing.assert_array_equal(view["reach"], np.ones((50, 3)))
    names = ("reach", "values", "ok", "lists/numbers", "label", "hardness", "lists/letters")
    assert [name in view for name in names] == [True] * 5 + [False] * 2
