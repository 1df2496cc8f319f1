"""Process units in worker processes of this machine, where one that hangs or dies costs no more than its unit."""

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import cached_property
from multiprocessing import resource_tracker, util
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from pipeline.engine.executor import Executor, Work, close_session, opening_error, pack, process_unit, record_crash
from pipeline.engine.stage import Unit
from pipeline.errors import StageError
from pipeline.store.rows import Result
from pipeline.store.temporary import environment, temporary_folder

TRIES = 2  # attempts per object: a process that dies may have been killed from outside; if it dies again, the object has failed
CLOSE_SECONDS = 10.0  # time limit for a worker to close its session
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # environment of workers: each has a core

NO_LEAKS = {"PYTHONWARNINGS": "ignore:resource_tracker:UserWarning"}
"""Environment of Python's tracker, which releases semaphores that libraries have in a worker when it is killed, and warns of them."""


class WorkerProcesses(Executor):
    """Worker processes that each process one object after the other; none is started before the first unit."""

    processes = 1

    def __init__(self, processes: int = 0) -> None:
        """Plan that many workers, by default one per core."""
        self.processes = processes or len(os.sched_getaffinity(0))
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []
        self._resources = ExitStack()

    @cached_property
    def _folder(self) -> Path:
        return self._resources.enter_context(temporary_folder())

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units. A worker that dies is replaced, and its unit tried again; if that dies too, the object has failed."""
        packed, waiting, limit = pack(work), deque(units), work.settings.object_seconds
        deaths: Counter[str] = Counter()  # by unit, of "" while a session opened

        def send(worker: _Worker, unit: Unit | None) -> None:
            self._busy.append(worker)
            worker.send(packed, unit, limit)

        try:
            for _ in range(min(self.processes, len(units))):
                send(self._worker(), None)
            while self._busy:
                ready = wait([worker.connection for worker in self._busy])
                for worker in [worker for worker in self._busy if worker.connection in ready]:
                    self._busy.remove(worker)
                    unit, result = worker.unit, None
                    try:
                        result = worker.receive()
                    except EOFError:
                        name = unit.name if unit else ""
                        deaths[name] += 1
                        if unit is None and deaths[name] == TRIES:
                            raise opening_error(work.stage.name) from None
                        if unit and deaths[name] == TRIES:
                            worker.process.join()
                            result = record_crash(work, unit, timed_out=worker.process.exitcode == -signal.SIGALRM)
                        elif unit:
                            waiting.append(unit)
                        if waiting:
                            send(self._worker(), None)
                    else:
                        deaths[""] = 0 if unit is None else deaths[""]
                        if waiting:
                            send(worker, waiting.popleft())
                        else:
                            self._idle.append(worker)
                    if result:
                        yield result
        finally:
            self._end_busy()

    def _worker(self) -> "_Worker":
        while self._idle:
            if (worker := self._idle.pop()).process.is_alive():
                return worker
        try:
            return _Worker(self._folder)
        except OSError as error:
            raise StageError(f"worker processes cannot start ({error}); run again with fewer --workers, or --executor serial") from error

    def _end_busy(self) -> None:
        for worker in self._busy:
            worker.kill()
        self._busy = []

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the workers; their sessions are closed first, unless there was an error."""
        self._end_busy()
        for worker in self._idle:
            worker.connection.close()
        for worker in self._idle:
            worker.process.join(0 if kind else CLOSE_SECONDS)
            worker.kill()
        self._idle = []
        self._resources.close()
        self.__dict__.pop("_folder", None)


class _Worker:
    """A worker process and the connection to it. `unit` is the one that it processes; None while it opens its session."""

    unit: Unit | None = None

    def __init__(self, folder: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with theirs, environment(ONE_THREAD | NO_LEAKS | {"TMPDIR": str(folder)}), ThreadPoolExecutor(1) as thread:
            thread.submit(self._start).result()  # this thread receives Ctrl-C, which thus interrupts no start halfway

    def _start(self) -> None:
        resource_tracker.ensure_running()  # started later, it would unblock SIGINT
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # the worker inherits it: Ctrl-C is for this process, which ends it
        self.process.start()

    def send(self, packed: bytes, unit: Unit | None, seconds: float) -> None:
        """Send a unit of a run, or only the run, whose session is to be opened."""
        self.unit = unit
        with suppress(ConnectionError):  # it died: `receive` says so
            self.connection.send((packed, unit, seconds))

    def receive(self) -> Result | None:
        """Receive the result of what was sent, or raise the error that ends the run; an `EOFError` if the worker has died."""
        try:
            reply: tuple[Result | None, Exception | None] = self.connection.recv()
        except OSError as died:
            raise EOFError from died
        result, error = reply
        if error:
            raise error
        return result

    def kill(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.join()
        self.connection.close()


def _serve(connection: Connection) -> None:
    """Process what the parent sends until it closes the connection."""
    end_with_parent()
    with suppress(EOFError, ConnectionError):
        while True:
            reply: tuple[Any, Exception | None]
            try:
                reply = process_unit(*connection.recv()), None
            except EOFError:
                break
            except Exception as error:
                reply = None, error
            connection.send(reply)
    close_session()
    util._exit_function()  # type: ignore[attr-defined]  # releases semaphores of libraries: Python would warn that they leak
    os._exit(0)  # an orderly exit of the interpreter takes half a second


def end_with_parent() -> None:
    """Start a thread that ends this process when its parent was killed, even in the middle of a unit."""

    def wait_for_parent() -> None:
        parent = multiprocessing.parent_process()
        assert parent
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_parent, daemon=True).start()
