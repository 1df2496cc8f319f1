"""Consoles, and progress: a bar on a terminal, a line every few seconds elsewhere."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterable, Sequence
from typing import TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Table

SECONDS_PER_LINE = 15.0
NAMED = 5
"""Objects or files named in one line."""
WIDE = 200
"""Columns where no terminal says how many it has: a table in a log is not squeezed."""


CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that steer how text is shown, its direction among them; the name of a thing has none."""


def visible(text: str) -> str:
    """Replace what is no printable character and no line break by its code, such as \\x1b."""
    return "".join(one if one.isprintable() or one == "\n" else repr(one)[1:-1] for one in text)


class _VisibleConsole(Console):
    """Prints the control characters of names and reasons as their codes: a terminal would obey them."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)


def console_on(stream: TextIO) -> Console:
    """Make a console on standard output or standard error."""
    width = None if stream.isatty() else WIDE
    return _VisibleConsole(stderr=stream is sys.stderr, highlight=False, emoji=False, soft_wrap=True, width=width)


console, errors = console_on(sys.stdout), console_on(sys.stderr)


def say(line: str) -> None:
    """Print a line as it is."""
    console.print(escape(line))


def counted(number: int, what: str = "object") -> str:
    """Write a number of things: 1 object, 2 objects."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def few(names: Sequence[str]) -> str:
    """List the first `NAMED` names."""
    return ", ".join(names[:NAMED]) + (", …" if len(names) > NAMED else "")


def print_table(console: Console, columns: Iterable[object], rows: Iterable[Iterable[object]], title: str = "") -> None:
    """Print a table without rules, below its title, which may be wider; cells may hold rich's markup."""
    table = Table(*map(str, columns), box=None, padding=(0, 2))
    for row in rows:
        table.add_row(*map(str, row))
    if title:
        console.print(f"\n[bold]{title}[/]")
    console.print(table)


class Meter:
    """Shows how far a piece of work is, `of` being what is counted; a context manager."""

    def __init__(self, console: Console, title: str, total: int, of: str, done: int = 0) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"))
        self._bar = Progress(*columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal, transient=True)
        self._bar.add_task(title, total=total, completed=done)
        (self._task,) = self._bar.tasks
        self._title, self._of, self._last = title, of, time.monotonic()

    def __enter__(self) -> Meter:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def advance(self, note: str = "") -> None:
        """Count one more; `note` says how it goes."""
        note, task = f", {note}" if note else "", self._task
        self._bar.update(task.id, advance=1, description=escape(self._title + note))
        if not self._bar.console.is_terminal and time.monotonic() - self._last > SECONDS_PER_LINE:
            self._last = time.monotonic()
            progress = f"{self._title}: {task.completed:.0f} of {task.total:.0f} {self._of}, {task.elapsed or 0:.0f} s{note}"
            self._bar.console.print(escape(progress))
