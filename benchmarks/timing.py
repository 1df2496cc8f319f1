"""Time several methods for the same work in turns, and print the results as Markdown tables.

Times are processor times of all threads of the process: a second thread brings no gain, and other work on the machine counts little.
"""

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
K = TypeVar("K")
Round = Callable[[], float]
"""Does its work once; returns processor milliseconds per item."""


@dataclass(frozen=True)
class Times:
    """Least and median processor milliseconds per item."""

    least: float
    median: float

    def __str__(self) -> str:
        return f"{three_digits(self.least)} / {three_digits(self.median)}"

    def over(self, other: "Times") -> str:
        """Format the ratio of the least times."""
        return f"{self.least / other.least:.2f}"


def three_digits(value: float) -> str:
    """Format three significant digits: 0.0123, 1.23, 12.3, 1230; below a thousandth as 1e-05."""
    if abs(value) < 1e-3 or not math.isfinite(value):
        return f"{value:.0e}" if value else "0"
    decimals = 2 - math.floor(math.log10(abs(value)))
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def quantiles(values: Any) -> str:
    """Format median, 99 % quantile and maximum."""
    return " / ".join(three_digits(float(np.quantile(values, q))) for q in (0.5, 0.99, 1))


def over_items(call: Callable[[T], object], items: Sequence[T]) -> Round:
    """Make a round that calls with every item, and returns the mean milliseconds of one call."""

    def once() -> float:
        start = time.process_time()
        for item in items:
            call(item)
        return (time.process_time() - start) * 1e3 / len(items)

    return once


def single_call(call: Callable[[], object]) -> Round:
    """Make a round of one call without arguments."""
    return over_items(lambda _: call(), [None])


def side_by_side(rounds: Mapping[K, Round], count: int) -> dict[K, Times]:
    """Time the rounds in turn, `count` times, after one turn to warm up."""
    samples: dict[K, list[float]] = {name: [] for name in rounds}
    for turn in range(count + 1):
        for name, once in rounds.items():
            milliseconds = once()
            if turn:
                samples[name].append(milliseconds)
    return {name: Times(min(times), median(times)) for name, times in samples.items()}


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Format a table, its first column to the left and the others to the right."""
    lines = (head, ["---", *["---:"] * (len(head) - 1)], *rows)
    return ["| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines]


@dataclass
class Table:
    """Hold a comparison: `columns` name the cells of every row after its name, `notes` say what is not comparable."""

    title: str
    columns: Sequence[str]
    notes: Sequence[str] = ()
    rows: list[tuple[str, ...]] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def add(self, name: str, *cells: object) -> None:
        """Add a row; raises ValueError unless it has one cell per column."""
        if len(cells) != len(self.columns):
            raise ValueError(f"row {name!r} has {len(cells)} cells; the table has {len(self.columns)} columns, {', '.join(self.columns)}")
        self.rows.append((name, *map(str, cells)))

    @contextmanager
    def peer(self, *names: str) -> Iterator[None]:
        """Add rows with the reason for peers that cannot be imported or run in this block."""
        try:
            yield
        except (ImportError, RuntimeError) as error:
            reason = " ".join(f"{error}{'; `make bench-peers` installs it' * isinstance(error, ImportError)}".split())
            for name in names:
                self.missing.append(f"{name}: {reason}")
                self.add(name, f"could not run: {reason}", *["–"] * (len(self.columns) - 1))

    def markdown(self, provenance: str) -> str:
        """Format heading, provenance, table and notes."""
        notes = [f"- {note}" for note in self.notes]
        return "\n".join([f"## {self.title}", "", provenance, "", *markdown(["", *self.columns], self.rows), "", *notes, ""])


def write_sections(page: Path, sections: Sequence[str]) -> None:
    """Replace a page's sections of the same titles, and add the others at its end."""
    head, *before = re.split(r"^(?=## )", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    by_title = {section.partition("\n")[0]: section.rstrip() for section in (*before, *sections)}
    page.write_text("\n\n".join([head.rstrip(), *by_title.values()]) + "\n", encoding="utf-8")
