"""The runner: skipping, resuming, failures, shards and workers."""

import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from pipeline.engine.runner import execute

from pipeline.config.manifest import Object
from pipeline.engine.plan import make_plan
from pipeline.engine.workers import Work, _Pool
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.rng import numpy_rng
from pipeline.store.collection import check_origins
from pipeline.store.directory import DataDirectory
from pipeline.store.validate import problems
from schemas.catalogue import ARTIFACTS
from tests.runner.tiny import MEAN, NOISE, Compare, Halve, MakeNoise, TakeMean, digest, objects, request, run


def stamps(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


def test_a_second_run_does_nothing_and_touches_no_file(tmp_path):
    assert run(request(tmp_path)) == 5
    before = stamps(tmp_path)
    assert run(request(tmp_path)) == 0
    assert stamps(tmp_path) == before


def test_what_changes_results_rebuilds_and_what_changes_speed_does_not(tmp_path):
    run(request(tmp_path))
    assert run(request(tmp_path, settings={"batch": 3})) == 0
    assert run(request(tmp_path, settings={"samples": 51})) == 5
    assert run(request(tmp_path, stage=TakeMean())) == 5
    assert run(request(tmp_path, stage=TakeMean(), settings={"samples": 3})) == 5


@pytest.mark.parametrize(("shards", "workers"), [(1, 2), (4, 1), (7, 2)])
def test_shards_and_workers_change_no_digest(tmp_path, shards, workers):
    for data, how in ((tmp_path / "one", {}), (tmp_path / "other", {"shards": shards, "workers": workers})):
        run(request(data, **how))
        run(request(data, stage=TakeMean(), **how))
    assert digest(tmp_path / "one") == digest(tmp_path / "other")
    assert digest(tmp_path / "one", MEAN) == digest(tmp_path / "other", MEAN)


def test_a_run_that_ends_in_the_middle_goes_on_where_it_was(tmp_path):
    run(request(tmp_path / "whole"))
    plan = make_plan(request(tmp_path / "cut"), 0)
    outcomes = execute(plan)
    next(outcomes)
    next(outcomes)
    outcomes.close()
    assert not plan.path.exists()
    assert len(plan.missing()) <= 3
    assert run(request(tmp_path / "cut")) <= 3
    assert digest(tmp_path / "cut") == digest(tmp_path / "whole")


def test_a_piece_that_a_power_cut_left_empty_is_made_again_whatever_is_asked(tmp_path):
    for more in ({"strict": True}, {"retry": True}):
        plan = make_plan(request(tmp_path / str(more), only="c"), 0)
        list(execute(plan))
        plan.pieces.path("c", plan.jobs[2].key).write_bytes(b"")
        assert run(request(tmp_path / str(more), **more)) == 5


def test_a_piece_that_was_cut_short_is_made_again(tmp_path):
    plan = make_plan(request(tmp_path, only="c"), 0)
    assert [outcome.object_id for outcome in execute(plan)] == ["c"]
    assert not plan.path.exists()  # the others are missing
    piece = plan.pieces.path("c", plan.jobs[2].key)
    piece.write_bytes(piece.read_bytes()[:100])
    assert run(request(tmp_path)) == 5


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
def test_whatever_an_output_is_a_function_of_belongs_to_its_key(tmp_path, change):
    before, after = (make_plan(request(tmp_path, **asked), 0) for asked in ({}, change))
    assert before.key != after.key


def test_inputs_of_different_making_are_not_combined(tmp_path):
    run(request(tmp_path))
    run(request(tmp_path, stage=TakeMean()))
    run(request(tmp_path, settings={"samples": 7}))
    with pytest.raises(StoreError, match="mean of a was made from other noise than stand there now; run its stage again"):
        make_plan(request(tmp_path, stage=Compare()), 0)
    assert "was made from other noise" in str(DataDirectory(tmp_path).collection(MEAN).stale([DataDirectory(tmp_path).collection(NOISE)]))
    run(request(tmp_path, stage=TakeMean(), settings={"samples": 7}))
    assert run(request(tmp_path, stage=Compare())) == 5


def test_what_an_input_was_made_from_is_looked_at_too(tmp_path, monkeypatch):
    for artifact in (NOISE, MEAN):
        monkeypatch.setitem(ARTIFACTS, artifact.name, artifact)
    run(request(tmp_path))
    run(request(tmp_path, stage=TakeMean()))
    assert run(request(tmp_path, stage=Halve())) == 5
    check_origins([DataDirectory(tmp_path).collection(MEAN)])
    run(request(tmp_path, settings={"samples": 7}))
    with pytest.raises(StoreError, match="mean of a was made from other noise than stand there now; run its stage again"):
        make_plan(request(tmp_path, stage=Halve()), 0)
    with pytest.raises(StoreError, match="mean of a was made from other noise than stand there now; run its stage again"):
        check_origins([DataDirectory(tmp_path).collection(MEAN)])
    for _, path in Layout(tmp_path).shards("noise"):  # given away to save room: then there is nothing to compare with
        shutil.rmtree(path)
    make_plan(request(tmp_path, stage=Halve()), 0)


def test_a_data_directory_of_other_objects_is_not_written_over(tmp_path):
    run(request(tmp_path, shards=2))
    x = Object("x", "letter", "train", {"trouble": None, "name": "x"})
    before = stamps(tmp_path / "noise")
    with pytest.raises(StoreError, match=r"holds other objects \(a, b, c, …\), and none of manifest tiny; name another --data"):
        run(request(tmp_path, items=[x]))
    assert stamps(tmp_path / "noise") == before
    assert run(request(tmp_path, items=[*objects(1), x])) == 1  # a manifest that changes keeps what it names still


def test_an_input_that_lost_a_chunk_is_not_read_as_zeros(tmp_path):
    run(request(tmp_path))
    for chunk in (path for path in (tmp_path / "noise" / "0000.zarr" / "values" / "c").rglob("*") if path.is_file()):
        chunk.unlink()
    lost = "values has lost 1 of its 1 files; delete the shard and run its stage again"
    with pytest.raises(StoreError, match=lost):
        run(request(tmp_path, stage=TakeMean()))
    with pytest.raises(StoreError, match=lost):  # whoever reads it, as trainings and the reader do
        DataDirectory(tmp_path).collection(NOISE).view("b")["values"]
    assert lost in problems(tmp_path / "noise" / "0000.zarr", NOISE)[0]


def test_rows_of_zeros_are_no_lost_ones(tmp_path):
    (tmp_path / "noise").mkdir()
    run(request(tmp_path, items=objects(3, a="bad", b="bad", c="bad")))
    shard = DataDirectory(tmp_path).collection(NOISE).shards[0]
    assert not shard.array("ok")[:].any()
    assert not shard.array("values")[:].any()


def test_an_object_that_was_mended_is_packed_at_once_and_the_others_stay(tmp_path):
    mended = tmp_path / "mended"
    items = objects(4, b=f"until {mended}", c="bad")
    run(request(tmp_path, items=items))
    mended.touch()
    made = list(execute(make_plan(request(tmp_path, items=items, retry=True, only="b"), 0)))
    assert [outcome.object_id for outcome in made] == ["b"]
    shard = DataDirectory(tmp_path).collection(NOISE).shards[0]
    assert [shard.failure(name) is None for name in "abcd"] == [True, True, False, True]


def test_a_run_whose_worker_died_while_idle_goes_on(tmp_path):
    plan = make_plan(request(tmp_path), 0)
    work = Work(plan.request.stage, plan.request.settings, 0, 1, tmp_path, {})
    with _Pool(work) as pool:
        pool.wait_until_open()
        (process,) = pool._executor._processes.values()
        process.kill()
        process.join()
        while not pool._executor._broken:
            time.sleep(0.01)
        assert pool.submit(plan.jobs[0]).result().reason is None


def test_shards_that_are_committed_together_drop_what_is_left_of_another_split_once(tmp_path):
    run(request(tmp_path, shards=4))
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda number: list(execute(make_plan(request(tmp_path, shards=2), number))), range(2)))
    assert [number for number, _ in Layout(tmp_path).shards("noise")] == [0, 1]


def test_a_stage_that_cannot_start_fails_no_object(tmp_path):
    with pytest.raises(StageError, match="make-noise cannot start: OSError: no device; `vt-pipeline doctor`"):
        run(request(tmp_path, stage=MakeNoise(broken=True)))
    assert run(request(tmp_path)) == 5


def test_failures_are_tried_again_when_asked(tmp_path):
    flag = tmp_path / "mended"
    items = objects(3, b=f"until {flag}")
    run(request(tmp_path, items=items))
    assert run(request(tmp_path, items=items)) == 0
    flag.touch()
    assert run(request(tmp_path, items=items)) == 0
    assert run(request(tmp_path, items=items, retry=True)) == 1
    assert DataDirectory(tmp_path).collection(NOISE).shard("b").failure("b") is None


def test_strict_minds_what_failed_before(tmp_path):
    list(execute(make_plan(request(tmp_path, items=objects(3, b="bad"), only="b"), 0)))
    with pytest.raises(InvalidInput, match="b: it is bad"):
        run(request(tmp_path, items=objects(3, b="bad"), strict=True))


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_coarser_split_takes_over_what_a_finer_one_made(tmp_path, order):
    run(request(tmp_path, shards=4))
    whole = digest(tmp_path)
    made = [len(list(execute(make_plan(request(tmp_path, shards=2), number)))) for number in order]
    assert made == [0, 0]
    assert [number for number, _ in Layout(tmp_path).shards("noise")] == [0, 1]
    assert digest(tmp_path) == whole
    assert not [*Layout(tmp_path).work("noise").glob("pieces/*")]


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_a_finer_split_takes_over_and_leaves_nothing_behind(tmp_path, order):
    run(request(tmp_path))
    whole = digest(tmp_path)
    assert sum(len(list(execute(make_plan(request(tmp_path, shards=3), number)))) for number in order) == 0
    assert digest(tmp_path) == whole
    assert not [*Layout(tmp_path).work("noise").glob("pieces/*")]


def test_another_label_is_packed_anew_and_nothing_computed(tmp_path):
    run(request(tmp_path))
    whole = digest(tmp_path)
    assert run(request(tmp_path, items=objects(5, split="test"))) == 0
    assert DataDirectory(tmp_path).collection(NOISE).shard("c").split("c") == "test"
    assert digest(tmp_path) != whole


def test_a_new_split_and_a_new_setting_together_use_no_old_row(tmp_path):
    for stage in (MakeNoise(), TakeMean()):
        run(request(tmp_path, stage=stage, shards=4))
    for number in (0, 1):  # as make goes: shard by shard through the stages
        for stage in (MakeNoise(), TakeMean()):
            list(execute(make_plan(request(tmp_path, stage=stage, shards=2, settings={"samples": 9}), number)))
    fresh = tmp_path / "fresh"
    for stage in (MakeNoise(), TakeMean()):
        run(request(fresh, stage=stage, settings={"samples": 9}))
    assert digest(tmp_path, MEAN) == digest(fresh, MEAN)


def test_another_split_takes_finished_rows_over(tmp_path):
    run(request(tmp_path))
    whole = digest(tmp_path)
    for shards in (3, 1):
        assert run(request(tmp_path, shards=shards)) == 0
        assert digest(tmp_path) == whole
        assert len(Layout(tmp_path).shards("noise")) == shards
    assert run(request(tmp_path, count=6)) == 1  # one object more


def test_each_failure_is_kept_with_its_reason_and_the_others_go_on(tmp_path, capfd):
    items = objects(6, b="bad", c="crash", d="bug", e="nan")
    run(request(tmp_path, items=items, workers=2))
    noise = DataDirectory(tmp_path).collection(NOISE)
    reasons = {name: failure["reason"] for name in noise if (failure := noise.shard(name).failure(name))}
    assert set(reasons) == set("bcde")
    assert reasons["b"] == "it is bad; make it good"
    assert "its process died 2 times" in reasons["c"]
    assert "unexpected ZeroDivisionError: a fault of ours" in reasons["d"]
    assert "values holds a value that is not finite" in reasons["e"]
    assert "ZeroDivisionError" in capfd.readouterr().err
    alone = tmp_path / "alone"
    run(request(alone, items=[item for item in items if item.object_id in "af"]))
    for name in "af":
        assert noise.shard(name).row_digest(name) == DataDirectory(alone).collection(NOISE).shard(name).row_digest(name)
    assert not noise.shard("a").array("ok")[1]
    assert (noise.shard("a").array("values")[1:5] == 0).all()


def test_a_failure_passes_down_under_the_stage_that_failed(tmp_path):
    items = objects(3, b="bad")
    run(request(tmp_path, items=items))
    assert run(request(tmp_path, stage=TakeMean(), items=items)) == 2
    mean = DataDirectory(tmp_path).collection(MEAN)
    assert mean.shard("b").failure("b") == {"stage": "make-noise", "reason": "it is bad; make it good"}


def test_a_shard_in_which_all_fail_is_a_valid_shard(tmp_path):
    items = objects(2, a="bad", b="bad")
    run(request(tmp_path, items=items))
    assert run(request(tmp_path, stage=TakeMean(), items=items)) == 0
    assert list(DataDirectory(tmp_path).collection(MEAN).shard("a").array("ok")[:]) == [False, False]


def test_strict_stops_at_the_first_failure(tmp_path):
    with pytest.raises(InvalidInput, match="b: it is bad"):
        run(request(tmp_path, items=objects(3, b="bad"), strict=True))
    assert not (tmp_path / "noise").exists()


def test_an_input_that_was_not_made_is_named(tmp_path):
    with pytest.raises(StoreError, match="has no object a; run the stage that makes noise first"):
        make_plan(request(tmp_path, stage=TakeMean()), 0)


def test_two_runs_of_one_shard_do_not_meet(tmp_path):
    outcomes = execute(make_plan(request(tmp_path), 0))
    next(outcomes)
    with pytest.raises(StoreError, match="is being made by another run"):
        list(execute(make_plan(request(tmp_path), 0)))
    list(outcomes)


def test_seeds_are_keyed_by_identity():
    draws = {numpy_rng(*identity).random() for identity in [(0, "a", "b"), (0, "ab"), (0, "a", "b", 1), (1, "a", "b"), (0, "b", "a")]}
    assert len(draws) == 5
    assert numpy_rng(0, "a", 1).random() == numpy_rng(0, "a", 1).random()


def test_rows_can_be_read_back(tmp_path):
    run(request(tmp_path))
    view = DataDirectory(tmp_path).collection(NOISE).view("c")
    assert str(view["label"]) == "letter"
    assert view["values"].dtype == np.float32
    np.testing.assert_array_equal(view["lists/numbers"], [1])
    np.testing.assert_array_equal(view["reach"], np.ones((50, 3)))
