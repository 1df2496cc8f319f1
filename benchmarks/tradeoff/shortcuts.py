"""Time the same work with and without every shortcut: `python -m benchmarks.tradeoff.shortcuts`.

Seconds are the processor's on one thread, the least of a few; what is timed is a stage's work on one modelled object, or one step
or batch of it. The names are those of `vt-pipeline run STAGE --explain`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from benchmarks.timing import alone, side_by_side
from benchmarks.tradeoff import shortcuts_data, shortcuts_learning
from benchmarks.tradeoff.shortcut import Results, Shortcut

EQUAL = "bit for bit"
TURNS = 2


def difference(ours: Results, plain: Results) -> float:
    """Compute the greatest difference of any number; 0 where all are equal to the bit, infinite where shapes or infinities differ."""
    worst = 0.0
    for name in ours.keys() | plain.keys():
        a, b = (np.asarray(results[name]) for results in (ours, plain))
        if a.shape != b.shape:
            return np.inf
        if a.tobytes() != b.tobytes():
            with np.errstate(invalid="ignore"):
                apart = np.where(a == b, 0, np.abs(a.astype(np.float64) - b.astype(np.float64)))
            worst = max(worst, float(np.nan_to_num(apart, nan=np.inf, posinf=np.inf).max()), np.finfo(np.float64).tiny)
    return worst


def measure(shortcut: Shortcut, turns: int = TURNS) -> dict[str, Any]:
    """Time both ways of a shortcut in turns, and compare their results; a row of the table."""
    apart = difference(shortcut.with_(), shortcut.without())
    times = side_by_side({way: alone(getattr(shortcut, way)) for way in ("with_", "without")}, turns)
    return {
        "stage": shortcut.stage,
        "name": shortcut.name,
        "what": shortcut.what,
        "seconds_with": float(f"{times['with_'].least / 1e3:.3g}"),
        "seconds_without": float(f"{times['without'].least / 1e3:.3g}"),
        "difference": f"{apart:.0e} {shortcut.unit}" if apart else EQUAL,
    }


def measure_all() -> list[dict[str, Any]]:
    """Measure every shortcut, in the order of the stages."""
    torch.set_num_threads(1)
    data, learning = shortcuts_data.Bench(size=2, attempts=12), shortcuts_learning.Bench()
    return [measure(one) for one in (*shortcuts_data.shortcuts(data), *shortcuts_learning.shortcuts(learning))]


if __name__ == "__main__":
    print(f"{'stage':16} {'shortcut':20} {'with, s':>9} {'without':>9} {'times':>6}  {'difference':14} what is left out")
    for row in measure_all():
        ours, plain = row["seconds_with"], row["seconds_without"]
        print(f"{row['stage']:16} {row['name']:20} {ours:9.4f} {plain:9.4f} {plain / ours:6.1f}  {row['difference']:14} {row['what']}")
