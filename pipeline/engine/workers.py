"""Worker processes: each keeps a stage's session open and takes one object after the other.

Each worker is a pool of its own, so that a native library that takes its process down takes no other object along, and
it is known which object it was.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from pipeline.config.manifest import Object
from pipeline.config.settings import Settings
from pipeline.engine.stage import ObjectStage, Task
from pipeline.errors import InvalidInput, PipelineError, StageError, StoreError
from pipeline.store.atomic import is_machine_fault
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory
from pipeline.store.pieces import Pieces
from pipeline.store.record import Failure
from pipeline.store.rows import Row, conform

CRASHES = 2
"""A process that dies may have been killed from outside; the object is to blame when it dies again."""

MORE_MEMORY = "with more memory, or the mesh made smaller, run again with --retry"


@dataclass(frozen=True)
class Job:
    """An object to process, the key its row is made under, and the digests of the rows it is made from, by artifact."""

    item: Object
    key: str
    inputs: dict[str, str]


@dataclass(frozen=True)
class Work:
    """What every worker of a run is told."""

    stage: ObjectStage
    settings: Settings
    seed: int
    data: Path
    models: Mapping[str, Path]


@dataclass(frozen=True)
class Outcome:
    """What became of a job: its row, or why there is none, lies among the pieces; unless there was a `bug`, told by its traceback."""

    object_id: str
    seconds: float
    failure: Failure | None = None
    bug: str | None = None


def run_jobs(work: Work, jobs: Sequence[Job], workers: int) -> Iterator[Outcome]:
    """Process jobs, in whatever order they finish: side by side in worker processes, or in this process if `workers` is 0.

    Raises
    ------
    StageError
        The stage's session cannot be opened: nothing is wrong with any object.
    StoreError
        An input is damaged.
    """
    if workers == 0:
        with ExitStack() as stack:
            try:
                process = stack.enter_context(_session(work))
            except Exception as error:
                raise _cannot_start(work, error) from error
            yield from map(process, jobs)
        return
    waiting = list(reversed(jobs))
    crashes: dict[str, int] = {}
    with ExitStack() as stack:
        idle = [stack.enter_context(_Pool(work)) for _ in range(max(1, min(workers, len(jobs))))]
        for pool in idle:
            pool.wait_until_open()
        running: dict[Future[Outcome], tuple[_Pool, Job]] = {}
        while waiting or running:
            while waiting and idle:
                pool, job = idle.pop(), waiting.pop()
                running[pool.submit(job)] = (pool, job)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                pool, job = running.pop(future)
                idle.append(pool)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    pool.restart()
                    crashes[job.key] = crashes.get(job.key, 0) + 1
                    if crashes[job.key] < CRASHES:
                        waiting.append(job)
                    else:
                        yield _crashed(work, job)


class _Pool:
    """One worker process that can be started again."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._start()

    def _start(self) -> None:
        spawn = multiprocessing.get_context("spawn")  # a fork would share GL contexts and locks
        self._executor = ProcessPoolExecutor(1, mp_context=spawn)
        others = set(multiprocessing.active_children())
        with _interrupts_ignored():  # the process starts here and inherits it: Ctrl-C is the main process's, which ends its workers
            self._opened = self._executor.submit(_open, self._work)
        self._processes = set(multiprocessing.active_children()) - others

    def wait_until_open(self) -> None:
        """Return when the session is open; all workers open theirs side by side."""
        for chance in range(1, CRASHES + 1):
            try:
                self._opened.result()
                return
            except BrokenProcessPool as error:  # somebody killed it, or the session's libraries did
                if chance == CRASHES:
                    raise StageError(
                        f"{self._work.stage.name} cannot start: its process died {CRASHES} times while it opened (killed, or memory ran "
                        "out?); run again, with fewer --workers where memory is short"
                    ) from error
                self._executor.shutdown(wait=False)
                self._start()
            except Exception as error:
                raise _cannot_start(self._work, error) from error

    def submit(self, job: Job) -> Future[Outcome]:
        try:
            return self._executor.submit(_process, job)
        except BrokenProcessPool:  # it died while it had nothing to do
            self.restart()
            return self._executor.submit(_process, job)

    def restart(self) -> None:
        self._executor.shutdown(wait=False)
        self._start()
        self.wait_until_open()

    def __enter__(self) -> _Pool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:  # nobody waits for the object that it has in hand
            for process in self._processes:
                process.kill()
        with suppress(Exception):  # it is broken, or was never open: then there is nothing to close
            self._executor.submit(_close).result()
        self._executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C for a moment, where this thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _cannot_start(work: Work, error: Exception) -> StageError:
    """What a stage's libraries raise where they are not installed as they should be, or a description file that cannot be used."""
    if isinstance(error, PipelineError):
        return StageError(f"{work.stage.name} cannot start: {error}")
    return StageError(f"{work.stage.name} cannot start: {type(error).__name__}: {error}; `vt-pipeline doctor` looks for what is missing")


def _crashed(work: Work, job: Job) -> Outcome:
    reason = f"its process died {CRASHES} times (a crash in a native library, or memory ran out); {MORE_MEMORY}"
    failure = Failure(stage=work.stage.name, reason=reason)
    pieces = Pieces(DataDirectory(work.data).work(work.stage.output.name))
    pieces.save(job.item.object_id, job.key, job.item.category, {}, seconds=0.0, failure=failure)
    return Outcome(job.item.object_id, 0.0, failure)


# ---- in the worker's process ------------------------------------------------------------------------------------------

_opened: dict[str, Any] = {}
"""What a worker's process keeps between jobs."""


def _open(work: Work) -> None:
    """Open the stage's session, and end with the parent, however that ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _opened["stack"] = ExitStack()
    _opened["process"] = _opened["stack"].enter_context(_session(work))


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


def _close() -> None:
    _opened["stack"].close()


def _process(job: Job) -> Outcome:
    outcome: Outcome = _opened["process"](job)
    return outcome


# ---- in whatever process works ----------------------------------------------------------------------------------------


@contextmanager
def _session(work: Work) -> Iterator[Callable[[Job], Outcome]]:
    """Open what a stage keeps between objects; yields what processes a job and saves its row, or why there is none."""
    directory, name = DataDirectory(work.data), work.stage.output.name
    inputs = {artifact.name: directory.collection(artifact) for artifact in work.stage.inputs(work.settings)}
    pieces = Pieces(directory.work(name))

    with work.stage.session(work.settings, work.models) as process:

        def do(job: Job) -> Outcome:
            task = make_task(job, work.seed, inputs)
            began = time.perf_counter()
            row: Row = {}
            failure = None
            try:
                row = conform(work.stage.output, process(task))
            except InvalidInput as error:
                failure = Failure(stage=work.stage.name, reason=str(error))
            except MemoryError:
                failure = Failure(stage=work.stage.name, reason=f"memory ran out; {MORE_MEMORY}")
            except Exception as error:  # a fault of ours: the other objects are processed all the same
                if is_machine_fault(error):
                    raise
                return Outcome(job.item.object_id, time.perf_counter() - began, bug=traceback.format_exc())
            seconds = time.perf_counter() - began
            pieces.save(job.item.object_id, job.key, job.item.category, row, seconds=seconds, failure=failure)
            return Outcome(job.item.object_id, seconds, failure)

        yield do


def make_task(job: Job, seed: int, collections: Mapping[str, Collection]) -> Task:
    """Make the task of a job, whose inputs are verified to be what the plan was made with.

    Raises
    ------
    StoreError
        An input is damaged, or was replaced since.
    """
    item = job.item
    views = {name: collection.view(item.object_id) for name, collection in collections.items()}
    for name, view in views.items():
        if collections[name].row(item.object_id).digest != job.inputs[name]:
            raise StoreError(f"{view.shard.path}: {name} of {item.object_id} was replaced meanwhile; run again")
        view.verify()
    return Task(
        object_id=item.object_id,
        category=item.category,
        seed=seed,
        source=item.source,
        inputs=views,
        attributes={name: view.shard.attributes for name, view in views.items()},
    )
