"""What a big run took, as Markdown: from samples of its processes, and from the records of its data directory."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import mean, median
from typing import Any

from benchmarks.timing import three_digits
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory

WORST = 20

Samples = Sequence[dict[str, Any]]


def samples_beside(data: Path) -> Path:
    """The file with the samples of the run that made a data directory."""
    return data.absolute().with_name(f"{data.absolute().name}.samples.jsonl")


def tables(data: Path, samples: Samples, workers: int) -> Iterator[str]:
    """Write every table, line by line."""
    made = {shard.record.stage: one for one in _collections(data) for shard in one.shards}
    by_stage = {stage: [one for one in samples if one["stage"] == stage] for stage in made}
    yield from markdown(
        (
            "stage",
            "objects",
            "failed",
            "wall s",
            "CPU s",
            "per core and hour",
            "per hour of CPU",
            "median s",
            "slowest / median",
            "MB",
            "files",
        ),
        [_rates(stage, made[stage], by_stage[stage], workers) for stage in made if by_stage[stage]],
    )
    yield from markdown(
        ("stage", "samples", "main MB, second → last quarter", "workers MB, second → last quarter", "all, most MB", "open files, most"),
        [_memory(stage, some) for stage, some in by_stage.items() if some],
    )
    yield from markdown(("stage", "failures", "reason", "such as"), list(_failures(made)))
    for stage, collection in made.items():
        times = seconds(collection)
        middle = median(times.values())
        worst = sorted(times, key=lambda name: times[name], reverse=True)[:WORST]
        yield f"\nSlowest of {stage}, seconds (× median): " + ", ".join(
            f"{name} {three_digits(times[name])} ({times[name] / middle:.1f})" for name in worst
        )


def seconds(collection: Collection) -> dict[str, float]:
    """What each object of this stage took; without those that an earlier stage failed."""
    rows = {name: collection.row(name) for name in collection}
    own = {shard.record.stage for shard in collection.shards}
    return {name: row.seconds for name, row in rows.items() if row.failure is None or row.failure.stage in own}


def _collections(data: Path) -> list[Collection]:
    directory = DataDirectory(data)
    return [directory.collection(artifact) for artifact in directory.artifacts()]


def _rates(stage: str, collection: Collection, samples: Samples, workers: int) -> tuple[str, ...]:
    times, wall = seconds(collection), samples[-1]["seconds"]
    middle = median(times.values())
    cpu = max(one["cpu"] for one in samples)
    files = [path for shard in collection.shards for path in shard.path.rglob("*") if path.is_file()]
    return (
        stage,
        str(len(times)),
        str(sum(failure is not None and failure.stage == stage for failure in map(collection.failure, collection))),
        f"{wall:.0f}",
        f"{cpu:.0f}",
        f"{3600 * len(times) / (wall * workers):.0f}",
        f"{3600 * len(times) / cpu:.0f}",
        three_digits(middle),
        f"{max(times.values()) / middle:.1f}",
        f"{sum(path.stat().st_size for path in files) / 1e6:.0f}",
        str(len(files)),
    )


def _memory(stage: str, samples: Samples) -> tuple[str, ...]:
    """Compare the second quarter of a stage with its last: in the first, workers start; memory that only grows would show."""
    alive = [one for one in samples if one["main"] and one["workers"]]
    quarter = max(1, len(alive) // 4)

    def change(megabytes: list[float]) -> str:
        return f"{mean(megabytes[quarter : 2 * quarter]):.0f} → {mean(megabytes[-quarter:]):.0f}"

    return (
        stage,
        str(len(alive)),
        change([one["main"] / 1e6 for one in alive]),
        change([mean(one["workers"].values()) / 1e6 for one in alive]),
        f"{max(one['main'] + sum(one['workers'].values()) for one in alive) / 1e6:.0f}",
        str(max(one["open"] for one in alive)),
    )


def _failures(made: dict[str, Collection]) -> Iterator[tuple[str, ...]]:
    """Group failures by reason, numbers and names left aside."""
    for stage, collection in made.items():
        alike: dict[str, list[str]] = defaultdict(list)
        for name in collection:
            failure = collection.failure(name)
            if failure is not None and failure.stage == stage:
                alike[re.sub(r"\d[\d.e+-]*", "N", failure.reason.replace(name, "OBJECT"))].append(name)
        for reason, names in sorted(alike.items(), key=lambda item: -len(item[1])):
            yield stage, str(len(names)), reason, ", ".join(names[:5])


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Write a table, after an empty line."""
    yield ""
    for line in (head, ["---"] * len(head), *rows):
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
