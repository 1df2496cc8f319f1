"""Tables as they are printed and as `docs/peers.md` keeps them: each under the command, commit, machine and date that made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date

from benchmarks.provenance import commit, machine


@dataclass
class Table:
    """A comparison: `columns` name the cells of every row but the first, which is who it is; `notes` say what is not comparable."""

    title: str
    columns: Sequence[str]
    notes: Sequence[str]
    rows: list[tuple[str, ...]] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def add(self, name: str, *cells: str) -> None:
        """A row.

        Raises
        ------
        ValueError
            There is not one cell a column.
        """
        if len(cells) != len(self.columns):
            raise ValueError(f"row {name!r} has {len(cells)} cells; the table has {len(self.columns)} columns, {', '.join(self.columns)}")
        self.rows.append((name, *cells))

    def could_not_run(self, name: str, why: object) -> None:
        """A row for a peer that is not measured, with the reason."""
        reason = " ".join(str(why).replace("|", "/").split())
        self.missing.append(f"{name}: {reason}")
        self.add(name, f"could not run: {reason}", *["–"] * (len(self.columns) - 1))

    def markdown(self, provenance: str) -> str:
        """Heading, provenance, table, notes."""
        lines = [f"## {self.title}", "", provenance, "", _line(["", *self.columns]), _line(["---", *["---:"] * len(self.columns)])]
        lines += [_line(row) for row in self.rows]
        return "\n".join([*lines, "", *(f"- {note}" for note in self.notes), ""])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def provenance(command: str) -> str:
    """The line above a table: by which command, commit and machine, and when."""
    return f"`{command}` · commit {commit()} · {machine()} · {date.today():%-d %B %Y}"
