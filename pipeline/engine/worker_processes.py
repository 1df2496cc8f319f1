"""Process units in worker processes of this machine, where one that hangs or dies costs no more than its unit."""

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from multiprocessing import resource_tracker, util
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from pipeline.engine.executor import Executor
from pipeline.engine.session import Work, record_crash
from pipeline.engine.unit import Unit
from pipeline.engine.worker import TRIES, close_session, crash_reason, opening_error, pack, process_unit
from pipeline.errors import StageError
from pipeline.store.row_files import Result
from pipeline.store.temporary import temporary_folder

CLOSE_SECONDS = 10.0
"""Time limit for a worker to close its session."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of workers: each has a core."""


class WorkerProcesses(Executor):
    """Worker processes that each process one object after the other; none is started before the first unit."""

    processes = 1

    def __init__(self, processes: int = 1) -> None:
        self.processes = processes
        self._idle: list[_Worker] = []
        self._busy: dict[Connection, _Worker] = {}
        self._resources = ExitStack()

    @cached_property
    def _folder(self) -> Path:
        """The folder for temporary files of workers."""
        return self._resources.enter_context(temporary_folder())

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units. A worker that dies is replaced, and its unit tried again; if that dies too, the object has failed."""
        packed, waiting, limit = pack(work), deque(units), work.settings.object_seconds
        deaths: Counter[str] = Counter()  # by unit, of "" while a session opened

        def send(worker: _Worker, unit: Unit | None) -> None:
            self._busy[worker.connection] = worker
            worker.send(packed, unit, limit)

        try:
            for worker in self._take(min(self.processes, len(units))):
                send(worker, None)
            while self._busy:
                for connection in wait([*self._busy]):
                    worker, result = self._busy[connection], None
                    name = worker.unit.name if worker.unit else ""
                    try:
                        result = worker.receive()
                        deaths[""] *= worker.unit is not None
                    except EOFError:
                        del self._busy[connection]
                        deaths[name] += 1
                        if worker.unit is None and deaths[name] == TRIES:
                            raise opening_error(work.stage.name) from None
                        if worker.unit and deaths[name] == TRIES:
                            result = record_crash(work, worker.unit, crash_reason(limit, worker.exit_code() == -signal.SIGALRM))
                        elif worker.unit:
                            waiting.append(worker.unit)
                        if waiting:
                            send(*self._take(1), None)
                    else:
                        if waiting:
                            send(worker, waiting.popleft())
                        else:
                            self._idle.append(self._busy.pop(connection))
                    if result:
                        yield result
        finally:
            self._end_busy()

    def _take(self, count: int) -> list["_Worker"]:
        """Take idle workers, and start as many as are missing."""
        living = [worker for worker in self._idle if worker.process.is_alive()]
        self._idle = living[count:]
        try:
            return living[:count] + [_Worker(self._folder) for _ in range(count - len(living))]
        except OSError as error:
            raise StageError(
                f"worker processes cannot be started ({error}); run again, with fewer --workers, or with --executor serial"
            ) from error

    def _end_busy(self) -> None:
        """End the workers that are in the middle of a unit."""
        for worker in self._busy.values():
            worker.kill()
        self._busy = {}

    def close(self, *, at_once: bool) -> None:
        """End the workers; their sessions are closed first, unless `at_once`."""
        self._end_busy()
        for worker in self._idle:
            worker.connection.close()
        for worker in self._idle:
            worker.process.join(0 if at_once else CLOSE_SECONDS)
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
        resource_tracker.ensure_running()  # started below, it would unblock SIGINT
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # workers inherit it: Ctrl-C is for this process, which ends them
        try:
            with theirs, _environment(ONE_THREAD | {"TMPDIR": str(folder)}):
                self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def send(self, packed: bytes, unit: Unit | None, seconds: float) -> None:
        """Send a unit of a run, or only the run, whose session is to be opened."""
        self.unit = unit
        with suppress(ConnectionError):  # it died: `receive` says so
            self.connection.send((packed, unit, seconds))

    def receive(self) -> Result | None:
        """Receive the result of what was sent, or raise the error that ends the run; an `EOFError` if the worker has died."""
        try:
            result, error = self.connection.recv()
        except OSError as died:
            raise EOFError from died
        if error:
            raise error
        return result

    def exit_code(self) -> int | None:
        """Wait for the end of the process; return its exit code, the negative number of the signal that ended it."""
        self.process.join()
        return self.process.exitcode

    def kill(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.join()
        self.connection.close()


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Change environment variables for a moment: a process that is started meanwhile inherits them."""
    before = {name: os.environ[name] for name in changes.keys() & os.environ.keys()}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name in changes:
            del os.environ[name]
        os.environ.update(before)


def _serve(connection: Connection) -> None:
    """Process what the parent sends until it closes the connection."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
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


def _end_with_parent() -> None:
    """End this process when its parent was killed, even in the middle of a unit."""
    parent = multiprocessing.parent_process()
    assert parent
    parent.join()
    os._exit(1)
