"""`python -m benchmarks.scale DATA`: what more objects would take, computed from what those of a data directory took.

Prints Markdown: measured rates; hours, bytes, files and cost; and the simulated scheduling of a million objects over 100 nodes.
"""

from __future__ import annotations

import argparse
import heapq
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.big_run_tables import markdown, samples_beside, seconds
from pipeline.store.directory import DataDirectory

COUNTS = (25, 1731, 1_000_000)
"""Objects: toy, the paper's, many."""

NODES, CORES = 100, 8
START = 15.0
"""Seconds from the start of a task to its first object: Python, libraries, the stage's session."""
MEAN_HOURS_TO_FAILURE = 20.0
"""Of one node: far worse than machines are, as preemptible ones may be."""
REPLACED_AFTER = 600.0
"""Seconds until a node that failed is there again, and its task elsewhere."""

CORE_HOUR, GB_MONTH, MILLION_PUTS = 0.04, 0.023, 5.0
"""US dollars: assumptions, near what large clouds ask for on demand in 2026; preemptible cores cost a third."""


@dataclass(frozen=True)
class Rates:
    """What one stage took: the seconds of each object, and means per object."""

    stage: str
    seconds: np.ndarray
    kilobytes: float
    files: float

    @property
    def mean(self) -> float:
        """Core seconds per object."""
        return float(self.seconds.mean())


@dataclass(frozen=True)
class Schedule:
    """When everything was done, what part of the nodes' time went into tasks, how many were interrupted."""

    hours: float
    used: float
    interrupted: int


def rates_of(data: Path) -> list[Rates]:
    """Read what the stages of a data directory took; what a shard has once is counted to its objects.

    Records have the seconds by the clock, which other programs lengthen. They are scaled to the processor's time of the whole
    stage, its start and packing with it, where `benchmarks.big_run` has sampled that beside the data directory.
    """
    directory, found = DataDirectory(data), []
    log = samples_beside(data)
    samples = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    for artifact in directory.artifacts():
        collection = directory.collection(artifact)
        taken = seconds(collection)
        files = [path.stat().st_size for shard in collection.shards for path in shard.path.rglob("*") if path.is_file()]
        count = len(collection)
        stage = collection.shards[0].record.stage
        times = np.array(list(taken.values()))
        if cpu := max((one["cpu"] for one in samples if one["stage"] == stage), default=0):
            times *= cpu / times.sum()
        found.append(Rates(stage, times, sum(files) / 1e3 / count, len(files) / count))
    return found


def durations(rates: Rates, objects: int, shards: int, rng: np.random.Generator) -> list[float]:
    """Draw how long a node takes for each shard: every object goes to the first core that is free."""
    found = []
    for drawn in np.array_split(rng.choice(rates.seconds, objects), shards):
        cores = [0.0] * CORES
        for one in drawn.tolist():
            heapq.heapreplace(cores, cores[0] + one)
        found.append(START + max(cores))
    return found


def schedule(tasks: Sequence[Sequence[float]], rng: np.random.Generator, *, failing: bool, keeping: bool) -> Schedule:
    """Schedule tasks over nodes, first come first served.

    Parameters
    ----------
    tasks
        For each shard its tasks' seconds; each is ready when the one before it is done.
    rng
        Draws when nodes fail.
    failing
        Whether they do.
    keeping
        Whether a task that is interrupted keeps the objects that it has finished.
    """
    nodes = [0.0] * NODES
    ready = [(0.0, shard, 0, own[0]) for shard, own in enumerate(tasks)]
    heapq.heapify(ready)
    end = used = 0.0
    interrupted = 0
    while ready:
        since, shard, number, left = heapq.heappop(ready)
        began = max(since, heapq.heappop(nodes))
        lasts = rng.exponential(3600 * MEAN_HOURS_TO_FAILURE) if failing else np.inf
        done = began + min(left, lasts)
        used += done - began
        if lasts < left:
            interrupted += 1
            heapq.heappush(nodes, done + REPLACED_AFTER)
            heapq.heappush(ready, (done, shard, number, START + left - lasts if keeping else left))
            continue
        heapq.heappush(nodes, done)
        end = max(end, done)
        if number + 1 < len(tasks[shard]):
            heapq.heappush(ready, (done, shard, number + 1, tasks[shard][number + 1]))
    return Schedule(end / 3600, used / (end * NODES), interrupted)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=__doc__)
    parser.add_argument("data", type=Path, help="data directory of a run of the four dataset stages")
    parser.add_argument("--objects", type=int, default=1_000_000, help="objects of the simulated schedule")
    given = parser.parse_args()
    rates = rates_of(given.data)
    print("\n".join([*_measured(rates), *_computed(rates), *_scheduled(rates, given.objects)]))


def _measured(rates: Sequence[Rates]) -> list[str]:
    head = (
        "stage",
        "objects",
        "core s per object",
        "median",
        "99 %",
        "slowest",
        "objects per core and hour",
        "kB per object",
        "files per object",
    )
    rows = []
    for one in rates:
        times = [f"{value:.2f}" for value in (one.mean, *np.quantile(one.seconds, [0.5, 0.99, 1.0]))]
        rows.append((one.stage, str(len(one.seconds)), *times, f"{3600 / one.mean:.0f}", f"{one.kilobytes:.0f}", f"{one.files:.2f}"))
    return list(markdown(head, rows))


def _computed(rates: Sequence[Rates]) -> list[str]:
    head = (
        "objects",
        "core hours",
        "on 2 cores",
        f"on {NODES} nodes of {CORES}",
        "GB",
        "files",
        "cores, $",
        "a month of storage, $",
        "puts, $",
    )
    rows = []
    for count in COUNTS:
        hours = count * sum(one.mean for one in rates) / 3600
        gigabytes = count * sum(one.kilobytes for one in rates) / 1e6
        files = count * sum(one.files for one in rates)
        money = [hours * CORE_HOUR, gigabytes * GB_MONTH, files / 1e6 * MILLION_PUTS]
        times = [_duration(value) for value in (hours / 2, hours / NODES / CORES)]
        rows.append((f"{count:,}", f"{hours:,.1f}", *times, f"{gigabytes:,.1f}", f"{files:,.0f}", *(f"{value:,.2f}" for value in money)))
    return list(markdown(head, rows))


def _duration(hours: float) -> str:
    return f"{hours:,.1f} h" if hours >= 1 else f"{60 * hours:.1f} min"


def _scheduled(rates: Sequence[Rates], objects: int) -> list[str]:
    head = ("shards", "no failures", "cores' time in use", "failures, finished objects kept", "interrupted", "failures, shards begun again")
    ideal = objects * sum(one.mean for one in rates) / 3600 / NODES / CORES
    rows = []
    for shards in (100, 500, 2000, 9999):
        rng = np.random.default_rng(0)
        tasks = list(zip(*(durations(one, objects, shards, rng) for one in rates), strict=True))
        smooth = schedule(tasks, np.random.default_rng(1), failing=False, keeping=True)
        kept = schedule(tasks, np.random.default_rng(1), failing=True, keeping=True)
        lost = schedule(tasks, np.random.default_rng(1), failing=True, keeping=False)
        hours = [f"{one.hours:.1f} h" for one in (smooth, kept, lost)]
        rows.append((str(shards), hours[0], f"{100 * ideal / smooth.hours:.0f} %", hours[1], str(kept.interrupted), hours[2]))
    return [f"\n{objects:,} objects, {NODES} nodes of {CORES} cores; without any loss {ideal:.1f} h", *markdown(head, rows)]


if __name__ == "__main__":
    main()
