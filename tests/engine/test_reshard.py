"""Reshard changes the number of shards without computing or losing rows."""

from __future__ import annotations

import itertools
import json
import os
import shutil

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.dataset.labelled import open_artifact
from pipeline.engine.executor import Serial
from pipeline.engine.make import plans
from pipeline.errors import StoreError
from pipeline.store import directory as directory_module
from pipeline.store import validate
from pipeline.store.atomic import exclusive_lock
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from pipeline.store.reshard import _set_shards, reshard
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import MEAN, NOISE, MakeNoise, TakeMean, digest, objects, published, request, run


def test_run_with_another_number_of_shards_is_refused_and_reshard_changes_it(tmp_path):
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path, stage=stage, shards=4))
    whole = digest(tmp_path), digest(tmp_path, MEAN)
    with pytest.raises(StoreError, match=r"is split into 4 shards, 2 were asked for; .* reshard .* 2"):
        run(request(tmp_path, shards=2))
    assert CliRunner().invoke(app, ["reshard", str(tmp_path), "1"]).output.endswith("1 shard per artifact, 2 groups written\n")
    with pytest.raises(StoreError, match=r"is split into 1 shard, 2 were asked for"):
        run(request(tmp_path, shards=2))
    for shards in (3, 1, 2):
        assert all(path.exists() for path in list(reshard(DataDirectory(tmp_path), shards)))
        assert (digest(tmp_path), digest(tmp_path, MEAN)) == whole
        assert not any(problems_below(tmp_path).values())
        assert all(
            plan.up_to_date() for stage in (MakeNoise(), TakeMean()) for plan in plans(request(tmp_path, stage=stage, shards=shards))
        )
        assert [run(request(tmp_path, stage=stage)) for stage in (MakeNoise(), TakeMean())] == [0, 0], "None takes the dataset's number"


def test_killed_reshard_changes_nothing_for_readers(tmp_path):
    run(request(tmp_path, shards=2))
    whole = digest(tmp_path)
    halfway = reshard(DataDirectory(tmp_path), 4)
    next(halfway)
    with pytest.raises(StoreError, match="is being made by another run"):
        next(reshard(DataDirectory(tmp_path), 3))
    halfway.close()
    assert DataDirectory(tmp_path).shards() == 2
    assert digest(tmp_path) == whole
    run(request(tmp_path, items=objects(3)))
    list(reshard(DataDirectory(tmp_path), 4))
    assert list(published(tmp_path)) == ["a", "b", "c"], "records of the one that was killed are gone"


def test_reshard_that_was_killed_towards_its_end_is_finished_by_the_same_command(tmp_path, monkeypatch):
    run(request(tmp_path, shards=2))
    whole = digest(tmp_path)
    with monkeypatch.context() as killed:
        killed.setattr("pipeline.store.reshard._set_shards", lambda *given: (_set_shards(*given), killed.undo(), 1 / 0))
        with pytest.raises(ZeroDivisionError):
            list(reshard(DataDirectory(tmp_path), 4))
    assert DataDirectory(tmp_path).shards() == 4
    assert list((tmp_path / "noise").glob("*-of-0002.json"))
    assert list(reshard(DataDirectory(tmp_path), 4)) == []
    assert not list((tmp_path / "noise").glob("*-of-0002.json"))
    assert digest(tmp_path) == whole


def test_replaced_groups_are_kept_for_their_readers(tmp_path):
    run(request(tmp_path, shards=2))
    groups = list((tmp_path / "noise").glob("*-of-0002-*.zarr"))
    for group in groups:
        os.utime(group, (0, 0))
    list(reshard(DataDirectory(tmp_path), 4))
    assert collect_everything(DataDirectory(tmp_path)) == []
    assert all(group.exists() for group in groups)


def test_rows_published_during_a_reshard_are_not_lost(tmp_path):
    run(request(tmp_path, shards=2))
    halfway = reshard(DataDirectory(tmp_path), 4)
    next(halfway)
    assert run(request(tmp_path, stage=TakeMean())) == 5
    with pytest.raises(StoreError, match="a stage published rows meanwhile"):
        list(halfway)
    assert list(published(tmp_path, MEAN)) == list("abcde")
    assert not any(problems_below(tmp_path).values())
    list(reshard(DataDirectory(tmp_path), 4))
    assert [run(request(tmp_path, stage=stage)) for stage in (MakeNoise(), TakeMean())] == [0, 0]


def test_run_that_ends_after_a_reshard_keeps_its_rows_for_the_next_run(tmp_path):
    run(request(tmp_path, shards=2))
    halfway = reshard(DataDirectory(tmp_path), 4)
    next(halfway)

    class Late(Serial):
        def run(self, work, units):
            yield from super().run(work, units)
            list(halfway)

    with pytest.raises(StoreError, match="is split into 4 shards, 2 were asked for"):
        run(request(tmp_path, stage=TakeMean(), executor=Late()), 0)
    assert not any(problems_below(tmp_path).values())
    before = len(list((tmp_path / ".work/mean/rows").glob("*/*.row")))
    assert before
    assert run(request(tmp_path, stage=TakeMean())) == 5 - before
    assert list(published(tmp_path, MEAN)) == list("abcde")


def test_unwritable_dataset_gives_an_error_with_a_remedy(tmp_path):
    run(request(tmp_path))
    shutil.rmtree(tmp_path / ".work")
    (tmp_path / ".work").write_text("a read-only disk ends in an OSError, too")
    with pytest.raises(StoreError, match=rf"{tmp_path}/.work cannot be written \(.*; make {tmp_path} writable, .* run again"):
        list(reshard(DataDirectory(tmp_path), 2))
    assert len(published(tmp_path)) == 5


@pytest.mark.parametrize("name", ["read_bytes", "read_record"])
def test_reader_that_opens_during_a_reshard_sees_all_objects(tmp_path, monkeypatch, name):
    run(request(tmp_path, shards=2))
    read = getattr(directory_module, name)

    def read_late(path, **options):
        monkeypatch.setattr(directory_module, name, read)
        list(reshard(DataDirectory(tmp_path), 4))
        return read(path, **options)

    monkeypatch.setattr(directory_module, name, read_late)
    assert list(DataDirectory(tmp_path).collection(NOISE)) == list("abcde")


def test_reshard_during_validation_is_not_reported_as_a_problem(tmp_path, monkeypatch):
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path, stage=stage, shards=2))
    check, checks = validate._record_problems, itertools.count()

    def check_late(record, artifact):
        if next(checks) == 1:
            list(reshard(DataDirectory(tmp_path), 4))
        return check(record, artifact)

    monkeypatch.setattr(validate, "_record_problems", check_late)
    assert not any(problems_below(tmp_path).values())
    assert next(checks) > 4, "it looked again"


def test_reshard_is_refused_while_a_run_is_at_work(tmp_path):
    run(request(tmp_path, shards=2))
    for artifact in ("noise", "mean"):  # `mean` has not been published yet
        with (
            exclusive_lock(DataDirectory(tmp_path).shard_lock(artifact, 0, 2), tmp_path),
            pytest.raises(StoreError, match="by another run"),
        ):
            list(reshard(DataDirectory(tmp_path), 4))


def test_xarray_attributes_list_the_failures_of_all_shards(tmp_path):
    items = objects(6, a="bad", b="bad", c="bad", d="bad", e="bad")
    run(request(tmp_path, items=items, shards=3))
    assert json.loads(open_artifact(tmp_path, "noise").attrs["failures"]).keys() == set("abcde")
