"""`vt-pipeline check`: what a description file says, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.completion import complete_described
from pipeline.console import print_line


def check(
    file: Annotated[
        str,
        typer.Argument(
            help="A hand, sensor, scene or manifest file, or the name of a shipped one.",
            autocompletion=complete_described("hand", "sensor", "scene", "manifest"),
        ),
    ],
    picture: Annotated[Path | None, typer.Option(help="PNG to draw it in; by default NAME.png in the current folder.")] = None,
) -> None:
    """Check and draw a hand, sensor, scene or manifest file.

    All faults are named at once.
    """
    from pipeline.reports.description_checks import check_file

    for line in check_file(file, picture):
        print_line(line)
