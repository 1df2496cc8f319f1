"""How commands talk: lines on standard output, errors on standard error."""

from __future__ import annotations

import sys
from typing import NoReturn

import typer
from rich.markup import escape

from pipeline.progress import console_on

console, errors = console_on(sys.stdout), console_on(sys.stderr)


def say(line: str) -> None:
    """Print a line as it is."""
    console.print(escape(line))


def fail(message: object) -> NoReturn:
    """Say what is wrong and end with status 1."""
    errors.print(f"[bold red]error:[/] {escape(str(message))}")
    raise typer.Exit(1)
