"""Code that runs in a Dask worker: the session of one stage at a time, and one unit after the other."""

import pickle
import signal
import tempfile
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from multiprocessing import util

from distributed import Worker, WorkerPlugin

from pipeline.engine import keys
from pipeline.engine.session import Work, session
from pipeline.engine.unit import Unit
from pipeline.errors import StageError
from pipeline.store.row_files import Result

_opened: tuple[bytes, AbstractContextManager[object], Callable[[Unit], Result]] | None = None
"""The pickled work whose session is open in this process; the session; and its function that processes a unit."""


class LocalWorker(WorkerPlugin):  # type: ignore[misc]  # which has no types
    """Prepares each worker, including those that replace others."""

    def setup(self, worker: Worker) -> None:
        """Prepare a worker; Dask calls this in its main thread."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that ends the workers
        tempfile.tempdir = worker.local_directory  # Dask clears those of workers that were killed


def open_session(packed: bytes) -> Callable[[Unit], Result]:
    """Open the session of a run's pickled work, unless it is open; close that of another run.

    A `StageError` says that it cannot be opened, or that this worker has other code than the sender of the work.
    """
    global _opened
    if _opened is None or _opened[0] != packed:
        close_session()
        work: Work
        _, code, work = pickle.loads(packed)
        if keys.code_hash(work.stage) != code:
            raise StageError(f"{work.stage.name}: a worker has other code than this process; install the same version for both")
        context = session(work)
        _opened = (packed, context, context.__enter__())
    return _opened[2]


def close_session() -> None:
    """Close the open session, in the thread that opened it, as OpenGL demands."""
    global _opened
    if _opened is not None:
        context, _opened = _opened[1], None
        context.__exit__(None, None, None)


def end_session() -> None:
    """Close the session of a worker that is about to be killed, and its libraries' semaphores: Python would warn that they leak."""
    close_session()
    util._exit_function()  # type: ignore[attr-defined]


def process_units(packed: bytes, units: Sequence[Unit], seconds: float) -> list[Result]:
    """Process units; the kernel ends this process, even in native code, when one of them takes `seconds`."""
    process, results = open_session(packed), []
    try:
        for unit in units:
            signal.setitimer(signal.ITIMER_REAL, seconds)
            results.append(process(unit))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return results
