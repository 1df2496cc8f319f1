"""Time several ways to do the same work, in turns, so that whatever else the machine does affects all of them alike.

Times are the processor's, of all threads of the process: a second thread is no gain.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypeVar

T = TypeVar("T")
K = TypeVar("K")
Round = Callable[[], float]
"""Does its work once; processor milliseconds per item."""


@dataclass(frozen=True)
class Times:
    """Least and median processor milliseconds per item."""

    least: float
    median: float

    def __str__(self) -> str:
        return f"{three_digits(self.least)} / {three_digits(self.median)}"


def three_digits(value: float) -> str:
    """Format three significant digits: 0.0123, 1.23, 12.3, 1230; below a thousandth as 1e-05."""
    if abs(value) < 1e-3 or not math.isfinite(value):
        return f"{value:.0e}" if value else "0"
    decimals = 2 - math.floor(math.log10(abs(value)))
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def each(call: Callable[[T], object], items: Sequence[T]) -> Round:
    """Make a round that calls with every item, and returns the mean milliseconds of one call."""

    def once() -> float:
        start = time.process_time()
        for item in items:
            call(item)
        return (time.process_time() - start) * 1e3 / len(items)

    return once


def alone(call: Callable[[], object]) -> Round:
    """Make a round of one call without arguments."""
    return each(lambda _: call(), [None])


def side_by_side(rounds: Mapping[K, Round], count: int) -> dict[K, Times]:
    """Time every way in turn, `count` times, after one turn to warm up."""
    taken: dict[K, list[float]] = {name: [] for name in rounds}
    for turn in range(count + 1):
        for name, once in rounds.items():
            milliseconds = once()
            if turn:
                taken[name].append(milliseconds)
    return {name: Times(min(times), median(times)) for name, times in taken.items()}
