"""Progress: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from pipeline.workers import Outcome

SECONDS_A_LINE = 15.0


def watch(console: Console, title: str, total: int, outcomes: Iterator[Outcome]) -> None:
    """Go through the outcomes of a run, showing how far it is, and end with a line that says what was done."""
    began = time.monotonic()
    done = failed = 0
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task(title, total=total)
        last = began
        for outcome in outcomes:
            done += 1
            failed += outcome.reason is not None
            progress.advance(task)
            if not console.is_terminal and time.monotonic() - last > SECONDS_A_LINE:
                last = time.monotonic()
                console.print(f"{title}: {done} of {total} objects, {last - began:.0f} s")
    console.print(f"{title}: made {done} objects in {time.monotonic() - began:.1f} s" + (f", {failed} failed" if failed else ""))
