"""`--object` takes one object through several stages; runs of the others then give the same bytes."""

import hashlib
import json
from pathlib import Path

import pytest

from pipeline.dataset.labelled import open_artifact
from pipeline.engine.make import make
from pipeline.errors import StoreError
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import (
    CONSOLE,
    MEAN,
    Average,
    MakeNoise,
    TakeMean,
    digest,
    leave_row,
    objects,
    plan_of,
    published,
    request,
    run,
)

STAGES = (MakeNoise(), TakeMean())


def contents(data: Path) -> dict[str, str]:
    """Return the digests of the files of all groups that records name."""
    groups = [shard.path for artifact in (published(data), published(data, MEAN)) for shard in artifact.shards]
    files = [file for group in groups for file in sorted(group.rglob("*")) if file.is_file()]
    return {str(file.relative_to(data)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


@pytest.mark.parametrize("shards", [1, 2])
def test_objects_run_alone_and_then_the_rest_give_the_same_bytes_as_one_run(tmp_path, shards):
    separate, whole = tmp_path / "one", tmp_path / "whole"
    for name in "cb":
        for stage in STAGES:
            assert run(request(separate, stage=stage, shards=shards, only=name)) == 1
            assert run(request(separate, stage=stage, shards=shards, only=name)) == 0
    assert sorted(published(separate)) == sorted(published(separate, MEAN)) == ["b", "c"]
    for stage in STAGES:
        assert run(request(separate, stage=stage)) == 3
        assert run(request(separate, stage=stage, only="a")) == 0
        run(request(whole, stage=stage, shards=shards))
    assert contents(separate) == contents(whole)
    assert not any(problems_below(separate).values())


def test_incomplete_shard_lists_its_missing_objects(tmp_path):
    run(request(tmp_path, only="b"))
    assert list(published(tmp_path).missing) == ["a", "c", "d", "e"]
    assert published(tmp_path).failure("a").reason == "not made yet"
    (lines,) = [lines for lines in problems_below(tmp_path).values() if lines]
    assert lines == ["4 objects of the manifest not made yet (a, c, d, e); run make-noise without --object"]
    assert json.loads(open_artifact(tmp_path, "noise").attrs["missing"]) == ["a", "c", "d", "e"]
    (foreseen,) = make(request(tmp_path, only="c"), CONSOLE, dry_run=True)
    assert foreseen.text.startswith("would make 1 of 5 objects")


def test_stage_without_the_input_of_an_object_is_refused(tmp_path):
    run(request(tmp_path, only="b"))
    for wanted in (request(tmp_path, stage=TakeMean(), only="a"), request(tmp_path, stage=TakeMean()), request(tmp_path, stage=Average())):
        with pytest.raises(StoreError, match="has no object a; "):
            plan_of(wanted)


def test_run_of_one_object_replaces_no_published_rows(tmp_path):
    run(request(tmp_path))
    before = digest(tmp_path)
    other = {"settings": {"samples": 9}}
    assert run(request(tmp_path, only="b", **other)) == 1
    assert digest(tmp_path) == before, "the other rows were made with other settings"
    assert run(request(tmp_path, only="b", items=objects(2), **other)) == 0
    assert digest(tmp_path) == before, "the other rows are of objects that left the manifest"
    record = plan_of(request(tmp_path)).record_path
    damaged = record.read_bytes()[:-9]
    record.write_bytes(damaged)
    assert run(request(tmp_path, only="b", **other)) == 0
    assert record.read_bytes() == damaged
    assert run(request(tmp_path, **other)) == 4


def test_rows_of_a_killed_run_are_published_by_the_run_of_all_objects(tmp_path):
    leave_row(request(tmp_path), "a")
    run(request(tmp_path, only="b"))
    assert list(published(tmp_path)) == ["b"]
    assert run(request(tmp_path)) == 3


def test_object_removed_from_the_manifest_is_not_missing(tmp_path):
    for name in "ab":
        run(request(tmp_path, items=objects(3), only=name))
    run(request(tmp_path, items=objects(2)))
    assert not published(tmp_path).missing
    record = (tmp_path / "noise" / "0000-of-0001.json").read_text()
    assert '"missing"' not in record  # so that older versions can read records of complete shards


def test_a_failure_is_published_with_its_reason_and_tried_again_alone(tmp_path):
    mended = tmp_path / "mended"
    items = objects(3, b=f"until {mended}")
    for stage in STAGES:
        run(request(tmp_path, stage=stage, items=items, only="b"))
    assert published(tmp_path, MEAN).failure("b").reason == "not yet"
    mended.touch()
    assert run(request(tmp_path, items=items, only="b", retry=True)) == 1
    assert run(request(tmp_path, stage=TakeMean(), items=items, only="b")) == 1
    assert published(tmp_path, MEAN).failure("b") is None


def test_strict_run_of_one_object_ignores_failures_of_others(tmp_path):
    items = objects(3, b=f"until {tmp_path / 'never'}")
    run(request(tmp_path, items=items))
    assert run(request(tmp_path, items=items, only="a", strict=True)) == 0
    assert run(request(tmp_path, items=items, only="a", strict=True, settings={"samples": 9})) == 1
