"""`python -m benchmarks.peers --data DIR [--write FILE] [--only TABLE …]`: every table, in one run, on one core."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import torch

from benchmarks.peers import chamfer, depth, store, surfaces, touch
from benchmarks.peers.cases import touched_objects
from benchmarks.peers.table import Table, provenance

INTRODUCTION = """# Side by side with what one would pick instead

Written by the command above each table, `make bench-peers`: every peer in one run, on one core of the same machine, with the same meshes
and sensor poses. Times are the processor's, in turns; notes below each table say what is not comparable. A ratio above 1 is in our favour.
"""
TURNS = 3
"""Rounds of every table, the first, which warms up, not counted."""


def main() -> None:
    """Measure, print, and write what was printed."""
    tables: dict[str, Callable[[Path, int], Table]] = {
        "touch": lambda data, turns: touch.measure(touched_objects(data), turns),
        "depth": lambda data, turns: depth.measure(touched_objects(data), turns),
        "chamfer": lambda data, turns: chamfer.measure(touched_objects(data), turns),
        "surfaces": lambda data, turns: surfaces.measure(touched_objects(data), turns),
        "store": store.measure,
    }
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="a dataset with surfaces, grasps and touches")
    parser.add_argument("--write", type=Path, help="put the tables there too; needs all of them")
    parser.add_argument("--only", nargs="+", choices=tables, default=list(tables), help="these tables alone")
    parser.add_argument("--turns", type=int, default=TURNS, help=f"rounds, {TURNS} if not said")
    chosen = parser.parse_args()
    if chosen.write and set(chosen.only) != set(tables):
        parser.error(f"--write wants every table, {', '.join(tables)}; --only names {', '.join(chosen.only)}")
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # of threads, those of Mesa too, only one runs at a time
    torch.set_num_threads(1)
    above = provenance(shlex.join(["python", "-m", "benchmarks.peers", *sys.argv[1:]]))
    measured = []
    for name in chosen.only:
        measured.append(tables[name](chosen.data, chosen.turns))
        print(measured[-1].markdown(above), flush=True)
    missing = [line for table in measured for line in table.missing]
    if chosen.write:
        chosen.write.write_text("\n".join([INTRODUCTION, *(table.markdown(above) for table in measured)]), encoding="utf-8")
    for line in missing:
        print(f"could not run: {line}", file=sys.stderr)
    print(f"{len(missing)} peers could not run", file=sys.stderr)


if __name__ == "__main__":
    main()
