"""Code that runs in a worker process: the session of one run at a time, and one unit after the other."""

import pickle
import signal
import uuid
from collections.abc import Callable
from contextlib import AbstractContextManager

from pipeline.engine import keys
from pipeline.engine.session import MORE_MEMORY, Work, session
from pipeline.engine.unit import Unit
from pipeline.errors import StageError
from pipeline.store.rows import Result

TRIES = 2
"""Attempts per object: a process that dies may have been killed from outside; if it dies again, the object has failed."""

_opened: tuple[bytes, AbstractContextManager[object], Callable[[Unit], Result]] | None = None
"""The pickled work whose session is open in this process; the session; and its function that processes a unit."""


def pack(work: Work) -> bytes:
    """Pickle the work of a run, with a number: each run opens its own sessions, for those of the previous run hold its inputs."""
    return pickle.dumps((uuid.uuid4(), keys.code_hash(work.stage), work))


def process_unit(packed: bytes, unit: Unit | None, seconds: float) -> Result | None:
    """Process a unit in the session of a run's packed work, which is opened first if need be; without a unit, only open it.

    The kernel ends this process, even in native code, when the unit takes `seconds`. A `StageError` says that the
    session cannot be opened, or that this worker has other code than the sender of the work.
    """
    process = _open_session(packed)
    if unit is None:
        return None
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return process(unit)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _open_session(packed: bytes) -> Callable[[Unit], Result]:
    """Open the session of a run, unless it is open; close that of another run."""
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


def opening_error(stage: str) -> StageError:
    """Describe a session whose process dies each time while it opens."""
    return StageError(
        f"{stage} cannot start: its process died each time while it opened (killed, or memory ran out?); "
        "run again, with fewer --workers where memory is short"
    )


def crash_reason(limit: float, timed_out: bool) -> str:
    """Explain why an object has failed whose process died."""
    if timed_out:
        return f"it took longer than object_seconds = {limit}; simplify the mesh, or raise it and run again with --retry"
    return f"its process died each time (a crash in a native library, or memory ran out); {MORE_MEMORY}"
