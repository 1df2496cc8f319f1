"""What commands print on a console, as tables for a page: one code makes both."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text


@dataclass(frozen=True)
class PrintedRow:
    """Hold a row's cells, and whether it was printed dim: the supplement's figures beside ours."""

    cells: list[str]
    dim: bool = False


@dataclass(frozen=True)
class PrintedTable:
    """Hold a table with its title; a line of text has a title alone."""

    title: str
    columns: list[str] = field(default_factory=list)
    rows: list[PrintedRow] = field(default_factory=list)


class _KeepingConsole(Console):
    """Keeps what it is given to print."""

    def __init__(self) -> None:
        super().__init__(file=io.StringIO())
        self.kept: list[Any] = []

    def print(self, *objects: Any, **_: Any) -> None:
        self.kept += objects


def printed(show: Callable[[Console], object]) -> list[PrintedTable]:
    """Call a function that prints on the console it is given, and return the tables and lines in order."""
    console = _KeepingConsole()
    show(console)
    found: list[PrintedTable] = []
    for one in console.kept:
        if not isinstance(one, Table):
            found.append(PrintedTable(_plain(one)))
            continue
        title = found.pop().title if found and not found[-1].columns and found[-1].title.startswith("\n") else ""
        columns = [_plain(column.header) for column in one.columns]
        rows = [PrintedRow(list(map(_plain, row)), str(row[0]).startswith("[dim]")) for row in _rows(one)]
        found.append(PrintedTable(title.strip(), columns, rows))
    return found


def _rows(table: Table) -> list[tuple[Any, ...]]:
    return list(zip(*(column.cells for column in table.columns), strict=True))


def _plain(cell: Any) -> str:
    return Text.from_markup(str(cell)).plain
