"""Worker processes that die, and sessions that cannot be opened."""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from pipeline.engine.stage import Task
from pipeline.engine.workers import Work, _Pool
from pipeline.errors import StageError, StoreError
from pipeline.store.rows import Row
from pipeline.store.validate import problems_below
from tests.engine.tiny_stages import MakeNoise, NoiseSettings, objects, plan_of, published, request, run


class DiesOpening(MakeNoise):
    """Kills its process while it opens, until `flag` is there; the flag is set by the first to die where `once`."""

    def __init__(self, flag: Path, once: bool) -> None:
        super().__init__()
        self.flag, self.once = flag, once

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Task], Row]]:
        if not self.flag.exists():
            if self.once:
                self.flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        with super().session(settings, models) as process:
            yield process


def test_a_run_whose_worker_died_while_idle_continues(tmp_path):
    plan = plan_of(request(tmp_path))
    work = Work(plan.stage, plan.settings, 0, tmp_path, {})
    with _Pool(work) as pool:
        pool.wait_until_open()
        (process,) = pool._executor._processes.values()
        process.kill()
        process.join()
        while not pool._executor._broken:
            time.sleep(0.01)
        outcome = pool.submit(plan.members[0].job).result()
        assert (outcome.failure, outcome.bug) == (None, None)


def test_a_stage_that_cannot_start_fails_no_object(tmp_path):
    with pytest.raises(StageError, match="make-noise cannot start: OSError: no device; `vt-pipeline doctor`"):
        run(request(tmp_path, stage=MakeNoise(broken=True)))
    assert run(request(tmp_path)) == 5


def test_a_worker_that_is_killed_while_it_opens_is_started_again(tmp_path):
    assert run(request(tmp_path, stage=DiesOpening(tmp_path / "flag", once=True), workers=1)) == 5


def test_a_worker_that_always_dies_while_it_opens_ends_the_run_in_words(tmp_path):
    with pytest.raises(StageError, match=r"make-noise cannot start: its process died 2 times while it opened .* fewer --workers"):
        run(request(tmp_path, stage=DiesOpening(tmp_path / "flag", once=False), workers=1))


@pytest.mark.parametrize("workers", [0, 1])
def test_a_disk_that_is_full_ends_the_run_with_its_path_and_loses_nothing(tmp_path, workers):
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, most))  # workers inherit it; what is cut short is a file of any object
    try:
        with pytest.raises(StoreError, match=r"noise/0000-of-0001 cannot be written: File too large; make room there, then run again"):
            run(request(tmp_path / "data", settings={"samples": 1000}, workers=workers))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert run(request(tmp_path / "data", settings={"samples": 1000})) == 5
    assert not any(problems_below(tmp_path / "data").values())


def test_memory_that_runs_out_is_the_objects_failure_and_the_others_go_on(tmp_path):
    run(request(tmp_path, items=objects(3, b="memory")))
    assert "memory ran out; with more memory, or the mesh made smaller" in published(tmp_path).failure("b").reason
    assert published(tmp_path).failure("c") is None
