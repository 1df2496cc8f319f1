"""Run functions in separate processes, which may end in any way."""

import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import PipelineError

OK, IN_WORDS, TRACEBACK = 0, 1, 2
"""Exit status of a run: success, an error with a remedy, or a traceback."""

HANGS = -signal.SIGALRM
"""Status of a run that was killed after `LIMIT` seconds."""
LIMIT = 300.0


@dataclass(frozen=True)
class End:
    """End of a run: its status (negative: the signal that killed it) and its output."""

    status: int
    output: str


def fork(work: Callable[[], object], log: Path) -> int:
    """Start a function in a new process and process group; its output goes to `log`."""
    log.write_text("")
    process = os.fork()
    if process:
        return process
    status = TRACEBACK
    try:
        status = _status_of(work, log)
    finally:
        while True:  # a signal that arrives now must not return into the code of the parent
            with suppress(BaseException):
                os._exit(status)


def _status_of(work: Callable[[], object], log: Path) -> int:
    os.setsid()
    opened = log.open("w")
    os.dup2(opened.fileno(), 1)
    os.dup2(opened.fileno(), 2)
    sys.stdout = sys.stderr = opened  # the caller may have replaced them
    try:
        work()
        return OK
    except SystemExit as error:
        return int(error.code or 0)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except (PipelineError, OSError) as error:  # the command line prints these without a traceback, too
        print(f"error: {error}", file=sys.stderr)
        return IN_WORDS
    except Exception:
        traceback.print_exc()
        return TRACEBACK
    finally:
        opened.flush()


def finish(process: int, log: Path, limit: float = LIMIT) -> End:
    """Wait for a process that `fork` started; one that hangs is killed."""
    deadline = time.monotonic() + limit
    while True:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return End(os.waitstatus_to_exitcode(status), log.read_text(errors="replace"))
        if time.monotonic() > deadline:
            os.killpg(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return End(HANGS, log.read_text(errors="replace"))
        time.sleep(0.005)


def run(work: Callable[[], object], log: Path) -> End:
    """Run a function in a separate process to its end."""
    return finish(fork(work, log), log)


def answer(work: Callable[[], Any], log: Path) -> Any:
    """Return a function's result, as JSON, from a separate process: Zarr's threads are absent from the next fork."""
    end = run(lambda: print(json.dumps(work())), log)
    if end.status != OK:
        raise RuntimeError(end.output.strip()[-600:])
    return json.loads(end.output.splitlines()[-1])
