"""Times of several ways to do the same work, taken in turns so that the machine's moods meet all of them.

Times are the processor's, of all threads of the process: what else the machine does counts little, and a second thread is no gain.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypeVar

T = TypeVar("T")
Round = Callable[[], float]
"""Does its work once and says how many processor milliseconds that took, an item."""


@dataclass(frozen=True)
class Times:
    """Least and median processor milliseconds an item."""

    least: float
    median: float

    def __str__(self) -> str:
        return f"{three_digits(self.least)} / {three_digits(self.median)}"


def three_digits(value: float) -> str:
    """A number with three digits that count: 0.0123, 1.23, 12.3, 1230; what is below a thousandth as 1e-05."""
    if abs(value) < 1e-3 or not math.isfinite(value):
        return f"{value:.0e}" if value else "0"
    decimals = 2 - math.floor(math.log10(abs(value)))
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def each(call: Callable[[T], object], items: Sequence[T]) -> Round:
    """A round that calls with every item and gives the mean milliseconds of one call."""

    def once() -> float:
        start = time.process_time()
        for item in items:
            call(item)
        return (time.process_time() - start) * 1e3 / len(items)

    return once


def side_by_side(rounds: Mapping[str, Round], count: int) -> dict[str, Times]:
    """Every way in turn, `count` times over, after one turn that warms up."""
    taken: dict[str, list[float]] = {name: [] for name in rounds}
    for turn in range(count + 1):
        for name, once in rounds.items():
            milliseconds = once()
            if turn:
                taken[name].append(milliseconds)
    return {name: Times(min(times), median(times)) for name, times in taken.items()}
