"""What leaving out saves: the same work with and without every shortcut, in turns. `python -m benchmarks.tradeoff.shortcuts`.

Seconds are the processor's on one thread, the least of a few; what is timed together is a stage's work on one modelled object, or
one step or batch of it. The names are those of `vt-pipeline run STAGE --explain`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import torch

from benchmarks.tradeoff import pairs_data, pairs_learning
from benchmarks.tradeoff.pairs import EQUAL, Pair, Results, difference

ROUNDS = 2
"""Timed turns, after one that warms up."""


@dataclass(frozen=True)
class Shortcut:
    """A shortcut of a stage, what it leaves out, processor seconds with and without it, and how far the results are apart."""

    stage: str
    name: str
    what: str
    seconds_with: float
    seconds_without: float
    difference: str


def measure() -> list[Shortcut]:
    """Every shortcut, in the order of the stages."""
    torch.set_num_threads(1)
    bench = pairs_data.Bench(size=2, attempts=12)
    return [measured(pair) for pair in (*pairs_data.pairs(bench), *pairs_learning.pairs(pairs_learning.Bench()))]


def measured(pair: Pair, rounds: int = ROUNDS) -> Shortcut:
    """Time both ways of a pair in turns and compare what they give."""
    ours, plain = pair.with_(), pair.without()
    seconds: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for way, spent in zip((pair.with_, pair.without), seconds, strict=True):
            spent.append(_seconds(way))
    apart = difference(ours, plain)
    return Shortcut(pair.stage, pair.name, pair.what, min(seconds[0]), min(seconds[1]), f"{apart:.0e} {pair.unit}" if apart else EQUAL)


def _seconds(way: Callable[[], Results]) -> float:
    start = time.process_time()
    way()
    return time.process_time() - start


def main() -> None:
    """Print the table."""
    print(f"{'stage':16} {'shortcut':20} {'with, s':>9} {'without':>9} {'times':>6}  {'difference':14} what is left out")
    for one in measure():
        times = one.seconds_without / one.seconds_with
        print(
            f"{one.stage:16} {one.name:20} {one.seconds_with:9.4f} {one.seconds_without:9.4f} {times:6.1f}  {one.difference:14} {one.what}",
            flush=True,
        )


if __name__ == "__main__":
    main()
