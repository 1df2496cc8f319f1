"""Measure stages and kernels beside raw limits and other tools: `python -m benchmarks [NAME …] --data DIR`.

Every table comes from one run on one core. Peers that are not installed are listed as such; `make bench-peers` installs them.
"""

import argparse
import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import torch

from benchmarks.provenance import provenance
from benchmarks.timing import Table, write_sections

PEERS = "touch", "elastic_gel", "depth", "chamfer", "surfaces", "store"
"""Tables of `docs/peers.md`."""
NAMES = "surfaces", "vision", "depth", "chamfer", "gcn", "touch", "elastic_gel", "presses", "slides", "store"
"""Modules of this folder; each has `measure(data, turns)`, which returns a table."""


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(NAMES)}; all unless given")
    parser.add_argument("--data", type=Path, required=True, help="a dataset with surfaces, grasps and touches")
    parser.add_argument("--write", type=Path, help=f"write the tables {', '.join(PEERS)} into this page")
    parser.add_argument("--turns", type=int, default=3, help="rounds after one to warm up; 3 unless given")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(NAMES):
        parser.error(f"there is no table {', '.join(sorted(unknown))}; there are {', '.join(NAMES)}")
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # of all threads, Mesa's among them, only one runs at a time
    torch.set_num_threads(1)
    origin = "`{command}` · commit {commit} · {machine} · {date}".format(**provenance("python -m benchmarks", "python -m benchmarks"))
    tables: list[Table] = []
    for name in PEERS if arguments.write else arguments.names or NAMES:
        measure: Callable[[Path, int], Table] = import_module(f"benchmarks.{name}").measure
        tables.append(measure(arguments.data, arguments.turns))
        print(tables[-1].markdown(origin), flush=True)
    if arguments.write:
        write_sections(arguments.write, [table.markdown(origin) for table in tables])
    for line in (line for table in tables for line in table.missing):
        print(f"could not run: {line}", file=sys.stderr)


if __name__ == "__main__":
    main()
