"""How commands end when something is wrong."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer
from rich.markup import escape

from pipeline.console import errors
from pipeline.errors import PipelineError


def fail(message: object) -> NoReturn:
    """Say what is wrong and end with status 1."""
    errors.print(f"[bold red]error:[/] {escape(str(message))}")
    raise typer.Exit(1)


@contextmanager
def failures_as_words() -> Iterator[None]:
    """End a command with words for whatever a person can mend; decorates every command."""
    try:
        yield
    except (PipelineError, OSError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("interrupted; what is finished is kept, run the same command to continue")
    except typer.Exit:
        raise
    except Exception:
        traceback.print_exc()
        fail("this is a bug in vt-pipeline; please report it with the traceback above. What is finished is kept")
