"""How commands end when something is wrong."""

from __future__ import annotations

from typing import NoReturn

import typer
from rich.markup import escape

from pipeline.console import errors


def fail(message: object) -> NoReturn:
    """Say what is wrong and end with status 1."""
    errors.print(f"[bold red]error:[/] {escape(str(message))}")
    raise typer.Exit(1)
