"""End commands with a message when something is wrong."""

import os
import signal
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

import typer
from rich.markup import escape

from pipeline.console import errors
from pipeline.errors import PipelineError, first_line
from pipeline.store.storage import is_machine_fault

AGAIN = "run the same command again, what is finished is kept"  # what to do after a command was stopped
RAISE_AGAIN_SECONDS = 0.5  # seconds after which Ctrl-C is raised again if it was swallowed


class _Terminated(KeyboardInterrupt):
    """Raised by SIGTERM, which ends a command as Ctrl-C does."""


def fail(message: object, *, status: int = 1) -> NoReturn:
    """Print an error and exit with this status."""
    errors.print(f"[bold red]error:[/] {escape(str(message))}")
    raise typer.Exit(status)


@contextmanager
def report_failures() -> Iterator[None]:
    """End a command with a message for faults that a user can fix, and for Ctrl-C and SIGTERM; decorates every command."""
    with _stoppable() as stopped:
        try:
            yield
        except (typer.Exit, BrokenPipeError):  # who reads the output has seen enough: click ends without a word
            raise
        except Exception as error:
            if stopped:  # a library turned it into another error
                raise stopped[0] from error
            if isinstance(error, PipelineError | OSError):
                fail(str(error).strip() or f"{type(error).__name__}; {AGAIN}")  # a timeout may say nothing
            if is_machine_fault(error):  # of object storage: its own kind of exception
                fail(f"object storage: {first_line(error)}; check that its address and credentials are in the environment")
            errors.print(escape(traceback.format_exc().rstrip()))
            fail("this is a bug in vt-pipeline; please report it with the traceback above. What is finished is kept")


@contextmanager
def _stoppable() -> Iterator[list[type[KeyboardInterrupt]]]:
    """End a command with a message on Ctrl-C and SIGTERM; yield a list that then holds the exception.

    Imports, callbacks of C code and destructors can swallow exceptions, so this one is raised again until it is being handled.
    """
    stopped: list[type[KeyboardInterrupt]] = []
    process, show_unraisable = os.getpid(), sys.unraisablehook

    def stop(number: int, frame: FrameType | None) -> None:
        if number != signal.SIGALRM:
            stopped[:] = [_Terminated if number == signal.SIGTERM else KeyboardInterrupt]
        if os.getpid() == process:  # a forked one is ended by this one
            signal.setitimer(signal.ITIMER_REAL, RAISE_AGAIN_SECONDS)
        if not _is_interrupting(sys.exception()):
            raise stopped[0]

    def hide(unraisable: "sys.UnraisableHookArgs") -> None:
        if not isinstance(unraisable.exc_value, KeyboardInterrupt):
            show_unraisable(unraisable)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    try:
        for number, handler in before.items():
            if number != signal.SIGINT or handler is not signal.SIG_IGN:  # as nohup and a shell's background jobs ask for
                signal.signal(number, stop)
        sys.unraisablehook = hide
        yield stopped
    except KeyboardInterrupt as ended_by:
        ended, number = ("terminated", signal.SIGTERM) if isinstance(ended_by, _Terminated) else ("interrupted", signal.SIGINT)
        fail(f"{ended}; {str(ended_by) or AGAIN}", status=128 + number)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        sys.unraisablehook = show_unraisable
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_interrupting(error: BaseException | None) -> bool:
    """Check whether Ctrl-C, or an error that it caused, is being handled: then resources are being closed."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None
