"""How commands end when something is wrong."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer
from rich.markup import escape

from pipeline.console import errors
from pipeline.errors import PipelineError, first_line
from pipeline.store.storage import is_machine_fault

KEPT = "what is finished is kept, run the same command to continue"


class _Terminated(KeyboardInterrupt):
    """SIGTERM came, which ends a command as Ctrl-C does."""


def _terminate(number: int, frame: object) -> None:
    raise _Terminated


def fail(message: object, *, status: int = 1) -> NoReturn:
    """Say what is wrong and end with this status."""
    errors.print(f"[bold red]error:[/] {escape(str(message))}")
    raise typer.Exit(status)


@contextmanager
def failures_as_words() -> Iterator[None]:
    """End a command with words for whatever a person can mend, and for Ctrl-C and SIGTERM; decorates every command."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        signal.signal(signal.SIGTERM, _terminate)
        if before[signal.SIGINT] is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        yield
    except (PipelineError, OSError) as error:
        fail(str(error) or f"{type(error).__name__}; {KEPT}")  # a timeout may say nothing
    except KeyboardInterrupt as stop:
        ended, number = ("terminated", signal.SIGTERM) if isinstance(stop, _Terminated) else ("interrupted", signal.SIGINT)
        fail(f"{ended}; {str(stop) or KEPT}", status=128 + number)
    except typer.Exit:
        raise
    except Exception as error:
        if is_machine_fault(error):  # of object storage: its own kind of exception
            fail(f"object storage: {first_line(error)}; see that its address and credentials are in the environment")
        errors.print(escape(traceback.format_exc().rstrip()))
        fail("this is a bug in vt-pipeline; please report it with the traceback above. What is finished is kept")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
