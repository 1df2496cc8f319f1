"""Objects that fail: recorded with reasons, tried again on request, and no others with them."""

import os
import stat

import pytest

from pipeline.config.sources import Object
from pipeline.engine.make import make
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.errors import BugFound, InvalidInput, StoreError
from tests.engine.tiny_stages import CONSOLE, MEAN, TakeMean, leave_row, objects, plan_of, published, request, run


def test_failures_are_tried_again_with_retry_only(tmp_path):
    flag = tmp_path / "mended"
    items = objects(3, b=f"until {flag}")
    run(request(tmp_path, items=items))
    assert run(request(tmp_path, items=items)) == 0
    flag.touch()
    assert run(request(tmp_path, items=items)) == 0
    assert run(request(tmp_path, items=items, retry=True)) == 1
    assert published(tmp_path).failure("b") is None


def test_dry_run_counts_unpublished_failures_that_retry_runs_again(tmp_path):
    flag = tmp_path / "mended"
    items = objects(3, b=f"until {flag}")
    for name in "ab":
        leave_row(request(tmp_path, items=items), name)
    assert [make(request(tmp_path, items=items, retry=retry), CONSOLE, dry_run=True)[0].objects for retry in (False, True)] == [1, 2]
    flag.touch()
    assert run(request(tmp_path, items=items, retry=True)) == 2


def test_strict_run_accepts_failures_of_earlier_stages_whether_or_not_it_is_up_to_date(tmp_path):
    items = objects(3, b="bad")
    run(request(tmp_path, items=items))
    later = request(tmp_path, stage=TakeMean(), items=items, strict=True)
    assert run(later) == 2
    assert run(later) == 0
    (made,) = make(later, CONSOLE)
    assert (made.text, made.failures) == ("up to date, 3 objects; 1 object failed in an earlier stage", {})


def test_retry_of_an_object_is_up_to_date_though_another_has_failed(tmp_path):
    items = objects(3, b="bad")
    run(request(tmp_path, items=items))
    up_to_date = {only: plan_of(request(tmp_path, items=items, retry=True, only=only)).up_to_date() for only in ("a", "b", None)}
    assert up_to_date == {"a": True, "b": False, None: False}


def test_failure_under_other_settings_is_ignored(tmp_path):
    mended = tmp_path / "mended"
    items = objects(3, b=f"until {mended}")
    run(request(tmp_path, items=items))
    mended.touch()
    with_more = request(tmp_path, items=items, settings={"samples": 60}, only="b")
    (made,) = make(with_more, CONSOLE)
    assert (made.objects, made.failures) == (1, {})


def test_failures_are_recorded_with_reasons_and_the_others_are_processed(tmp_path):
    items = objects(6, b="bad", c="crash")
    run(request(tmp_path, items=items, executor=WorkerProcesses(2)))
    noise = published(tmp_path)
    reasons = {name: failure.reason for name in noise if (failure := noise.failure(name))}
    assert set(reasons) == set("bc")
    assert reasons["b"] == "it is bad; make it good"
    assert "its process died each time" in reasons["c"]
    alone = tmp_path / "alone"
    run(request(alone, items=[item for item in items if item.object_id in "af"]))
    for name in "af":
        assert noise.row(name).digest == published(alone).row(name).digest
    assert not noise.first.read("ok")[1]
    assert (noise.first.read("values")[1:3] == 0).all()


@pytest.mark.parametrize("content", [b"[" * 200_000, b"", None], ids=["nested", "empty", "socket"])
def test_unreadable_file_fails_its_object_and_the_others_are_processed(tmp_path, content):
    file = tmp_path / "b.gltf"
    os.mknod(file, stat.S_IFSOCK | 0o600) if content is None else file.write_bytes(content)
    items = [Object("b", "letter", {"file": str(file), "root": str(tmp_path)}, "train"), *objects(1)]
    run(request(tmp_path / "data", items=items))
    noise = published(tmp_path / "data")
    assert noise.failure("b").reason.startswith("its file cannot be read: b.gltf ")
    assert noise.failure("a") is None


@pytest.mark.parametrize(
    ("trouble", "message"), [("bug", "ZeroDivisionError: a fault of ours"), ("nan", "holds a value that is not finite")]
)
def test_bug_is_reported_with_its_traceback_and_the_others_are_processed(tmp_path, trouble, message):
    with pytest.raises(BugFound, match="processing d met a bug in vt-pipeline") as caught:
        run(request(tmp_path, items=objects(5, d=trouble)))
    assert "Traceback" in str(caught.value)
    assert message in str(caught.value)
    assert not len(published(tmp_path))
    assert run(request(tmp_path)) == 1, "the rows of the others are kept"


def test_damage_that_a_stage_finds_in_its_input_ends_the_run_and_is_no_bug(tmp_path):
    with pytest.raises(StoreError, match="its sensor cannot be used"):
        run(request(tmp_path, items=objects(2, b="lost")))


def test_forecast_takes_no_mean_over_objects_that_failed_before_and_took_no_time(tmp_path):
    run(request(tmp_path, items=objects(1, a="bad")))
    run(request(tmp_path, stage=TakeMean(), items=objects(1, a="bad")))
    run(request(tmp_path, items=objects(2, a="bad")))
    (foreseen,) = make(request(tmp_path, stage=TakeMean(), items=objects(2, a="bad")), CONSOLE, dry_run=True)
    assert foreseen.seconds == TakeMean().cost(None).seconds > 0


def test_shard_of_failed_objects_is_valid(tmp_path):
    items = objects(2, a="bad", b="bad")
    run(request(tmp_path, items=items))
    assert run(request(tmp_path, stage=TakeMean(), items=items)) == 0
    assert list(published(tmp_path, MEAN).first.read("ok")) == [False, False]
    assert not published(tmp_path).first.read("values").any()
    failure = published(tmp_path, MEAN).failure("b")
    assert (failure.stage, failure.reason) == ("make-noise", "it is bad; make it good")


@pytest.mark.parametrize("before", [False, True])
def test_strict_run_stops_at_the_first_failure_of_now_or_before(tmp_path, before):
    items = objects(3, b="bad")
    if before:
        run(request(tmp_path, items=items, only="b"))
    with pytest.raises(InvalidInput, match="b: it is bad"):
        run(request(tmp_path, items=items, strict=True))
    assert "a" not in published(tmp_path)
