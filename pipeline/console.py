"""Consoles, and progress: a bar on a terminal, a line every few seconds elsewhere."""

import io
import multiprocessing
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TextIO, TypeVar

from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Column
from rich.table import Table as RichTable

Item = TypeVar("Item")

SECONDS_PER_LINE = 15.0
NAMED = 5  # objects or files named in one line
REDIRECTED_WIDTH = 200  # columns where no terminal says how many it has: a table in a log is not squeezed


CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters, including those of text direction; no name may contain them."""


def visible(text: str) -> str:
    """Replace characters that cannot be printed, except line breaks, by their codes, such as \\x1b."""
    return "".join(character if character.isprintable() or character == "\n" else repr(character)[1:-1] for character in text)


class _VisibleConsole(Console):
    """Prints the control characters of names and reasons as their codes: a terminal would obey them."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)


def console_on(stream: TextIO) -> Console:
    """Make a console on standard output or standard error."""
    width = None if stream.isatty() else REDIRECTED_WIDTH
    return _VisibleConsole(stderr=stream is sys.stderr, highlight=False, emoji=False, soft_wrap=True, width=width)


console, errors = console_on(sys.stdout), console_on(sys.stderr)


def print_lines(*lines: object) -> None:
    """Print lines without interpreting markup."""
    for line in lines:
        console.print(escape(str(line)))


def print_warning(label: str, text: object) -> None:
    """Print a line on standard error that begins with a yellow label."""
    errors.print(f"[yellow]{label}[/] {escape(str(text))}")


def pluralise(number: int, what: str = "object") -> str:
    """Write a number of things: 1 object, 2 objects, 2 classes, 2 touches."""
    return f"{number} {what}{'' if number == 1 else 'es' if what.endswith(('s', 'ch')) else 's'}"


def duration(seconds: float) -> str:
    """Write a time: 40 s, 3.5 min, 2.1 h."""
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def abbreviate(names: Sequence[str]) -> str:
    """List the first `NAMED` names."""
    return ", ".join(names[:NAMED]) + (", …" if len(names) > NAMED else "")


Cell = object  # text, a number or an interval, which a format writes, a tuple of several, or None where there is no value
Columns = dict[str, tuple[str, Callable[[Any], Cell]]]
"""Of a table, by name with the unit: the format of its numbers, and the function that takes a cell from an entry."""


@dataclass(frozen=True)
class Row:
    """A row of a table; a dim one holds reference values."""

    cells: Sequence[Cell]
    dim: bool = False


@dataclass(frozen=True)
class Table:
    """A table as data, from which prints, pages and files are made; without columns, a line of text."""

    title: str  # printed above the table; plain text
    columns: Sequence[str] = ()  # their names, with units
    rows: Sequence[Row] = ()  # from top to bottom
    formats: Sequence[str] = ()  # of each column's numbers, as `format` takes them; by default none

    def text(self, row: Row) -> list[str]:
        """Write the cells of a row."""
        formats = self.formats or [""] * len(row.cells)
        return [cell_text(cell, form) for cell, form in zip(row.cells, formats, strict=True)]


def tabulate(title: str, heading: str, entries: Mapping[str, Any], columns: Columns) -> Table:
    """Make a table with a row per entry, whose names are in the column `heading`."""
    rows = [Row([name, *(cell(entry) for _, cell in columns.values())]) for name, entry in entries.items()]
    return Table(title, [heading, *columns], rows, ["", *(form for form, _ in columns.values())])


def cell_text(cell: Cell, form: str = "") -> str:
    """Write a cell, its numbers formatted by `form`, several between slashes."""
    if cell is None:
        return "–"
    if isinstance(cell, tuple):
        return " / ".join(cell_text(part, form) for part in cell)
    return cell if isinstance(cell, str) else f"{cell:{form}}"


def show_tables(tables: Iterable[Table], console: Console = console) -> None:
    """Print tables without rules, each below its title, and lines of text between them."""
    for table in tables:
        if not table.columns:
            console.print(escape(table.title))
            continue
        shown = RichTable(*(Column(escape(name), overflow="fold") for name in table.columns), box=None, padding=(0, 2))
        for row in table.rows:
            shown.add_row(*map(escape, table.text(row)), style="dim" if row.dim else None)
        if table.title:  # it may be wider than the table
            console.print(f"\n[bold]{escape(table.title)}[/]")
        console.print(shown)


def table_lines(table: Table) -> list[str]:
    """Write a table as lines of text, its columns aligned."""
    text = io.StringIO()
    show_tables([table], Console(file=text, width=REDIRECTED_WIDTH, highlight=False, emoji=False))
    return [line.rstrip() for line in text.getvalue().splitlines()]


class Meter:
    """Shows progress; a context manager. `of` names what is counted; work of less than `after` seconds shows no bar."""

    def __init__(self, console: Console, title: str, total: int, of: str, done: int = 0, after: float = 0.0) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"))
        ours = console.is_terminal and multiprocessing.parent_process() is None  # workers write to their parent's terminal
        self._bar = Progress(*columns, TimeRemainingColumn(), console=console, disable=not ours, transient=True)
        self._bar.add_task(title, total=total, completed=done)
        (self._task,) = self._bar.tasks
        self._title, self._of, self._last = title, of, time.monotonic()
        self._shown_from = self._last + after

    def __enter__(self) -> "Meter":
        self._show()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def _show(self) -> None:
        """Show the bar from `after` seconds on."""
        if time.monotonic() >= self._shown_from:
            self._bar.start()

    def advance(self, note: str = "") -> None:
        """Count one more; `note` is shown beside the title."""
        self._show()
        note, task = f", {note}" if note else "", self._task
        self._bar.update(task.id, advance=1, description=escape(self._title + note))
        if not self._bar.console.is_terminal and time.monotonic() - self._last > SECONDS_PER_LINE:
            self._last = time.monotonic()
            progress = f"{self._title}: {task.completed:.0f} of {task.total:.0f} {self._of}, {task.elapsed or 0:.0f} s{note}"
            self._bar.console.print(escape(progress))


def with_progress(items: Sequence[Item], title: str, of: str = "objects", after: float = 0.0) -> Iterator[Item]:
    """Iterate over items, with a meter on standard error."""
    with Meter(errors, title, len(items), of, after=after) as meter:
        for item in items:
            yield item
            meter.advance()
