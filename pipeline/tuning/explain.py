"""Count what a run modelled and what it left out, for `run STAGE --explain`.

Each stage's counts are in `pipeline.tuning.explanations`. Those of an object stage are taken on a few objects of a shard, those
of a dataset stage on the folder that it filled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from pipeline.console import console
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.folders import plan_folder
from pipeline.engine.plan import Plan, Request
from pipeline.engine.stage import SetJob, SetStage, Stage, Task
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from pipeline.store.pieces import Row
from pipeline.store.shard import Shard
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS

OBJECTS = 4
"""Objects of a shard that are counted, spread evenly: about a second each."""


@dataclass(frozen=True)
class Count:
    """Things of one kind: how many were modelled, how many left out, and why these were.

    `shortcut` is the name, in `benchmarks/tradeoff/shortcuts.py`, of what saves the work; empty where settings, method or scene
    ask for no more.
    """

    what: str
    modelled: int
    left_out: int
    why: str
    shortcut: str = ""


@dataclass(frozen=True)
class Explanation:
    """What a run modelled and left out, with a title that says on which objects it was counted."""

    title: str
    counts: Sequence[Count]

    def table(self) -> Table:
        """Lay out the counts for a console."""
        table = Table(box=None, padding=(0, 2, 0, 0))
        for name in ("", "modelled", "left out", "%", "why it was left out", "shortcut"):
            table.add_column(name, justify="right" if name in ("modelled", "left out", "%") else "left")
        for count in self.counts:
            total = count.modelled + count.left_out
            share = f"{100 * count.left_out / total:.0f}" if total else "–"
            why = escape(count.why) if count.left_out else ""
            table.add_row(escape(count.what), f"{count.modelled:,}", f"{count.left_out:,}", share, why, count.shortcut)
        return table


def explain_shard(plan: Plan) -> Explanation | None:
    """Explain a shard that is up to date, on a few of its objects (on `only`, if one was asked for).

    Returns
    -------
    Explanation or None
        None where no object of the shard was processed.
    """
    request, stage = plan.request, plan.request.stage
    tasks = processed_tasks(plan)
    if not tasks:
        return None
    chosen = [tasks[number] for number in np.unique(np.linspace(0, len(tasks) - 1, OBJECTS).astype(int))]
    models = {name: record.folder for name, record in plan.records.items()}
    counts = _counts_of(stage)(request.settings, models, chosen)
    named = ", ".join(task.object_id for task in chosen)
    title = f"{stage.name} {plan.path}: counted on {len(chosen)} of {len(plan.jobs)} objects ({named})"
    return Explanation(title, total([*counts, shards_opened(stage, request.settings, request.data)]))


def explain_folder(request: Request[SetStage]) -> Explanation:
    """Explain the folder that a dataset stage filled."""
    plan, stage = plan_folder(request), request.stage
    models = {name: record.folder for name, record in plan.records.items()}
    counts = _counts_of(stage)(SetJob(request.data, plan.path, request.settings, request.seed, models, console))
    title = f"{stage.name} {plan.path}: counted on its objects"
    return Explanation(title, total([*counts, shards_opened(stage, request.settings, request.data)]))


def total(counts: Iterable[Count]) -> list[Count]:
    """Add up counts of the same things, left out for the same reason, in the order of their first mention."""
    found: dict[tuple[str, str, str], Count] = {}
    for count in counts:
        key = count.what, count.why, count.shortcut
        before = found.get(key, replace(count, modelled=0, left_out=0))
        found[key] = replace(count, modelled=count.modelled + before.modelled, left_out=count.left_out + before.left_out)
    return list(found.values())


def shards_opened(stage: Stage, settings: Any, data: Path) -> Count:
    """Count the shards in a data directory that a stage opens: those of its inputs."""
    inputs = {artifact.name for artifact in stage.inputs(settings)}
    own = {stage.output.name} if hasattr(stage, "output") else set()
    shards = {name: len(Layout(data).shards(name)) for name in ARTIFACTS if name not in own}
    closed = [name for name, count in shards.items() if count and name not in inputs]
    opened = sum(count for name, count in shards.items() if name in inputs)
    return Count("shards opened", opened, sum(shards.values()) - opened, f"no input of this stage with these settings: {', '.join(closed)}")


def arrays_read(names: Iterable[str], artifacts: Iterable[Artifact]) -> Count:
    """Count the arrays of its input artifacts that a dataset stage reads."""
    declared = {name for artifact in artifacts for name in artifact.arrays} - {"object_id", "category", "split", "ok"}
    read = set(names)
    return Count("arrays read", len(read), len(declared - read), "not used by this stage")


def processed_tasks(plan: Plan) -> list[Task]:
    """The tasks of a shard's processed objects, with the stage's own row among their inputs."""
    request, stage = plan.request, plan.request.stage
    collections = {artifact.name: Collection(plan.layout, artifact, request.shards) for artifact in stage.inputs(request.settings)}
    tasks = []
    for job in plan.jobs:
        own = _row(plan, job.item.object_id)
        if own is None or request.only not in (None, job.item.object_id):
            continue
        inputs = {name: collection.view(job.item.object_id) for name, collection in collections.items()}
        tasks.append(
            Task(
                object_id=job.item.object_id,
                category=job.item.category,
                seed=request.seed,
                source=job.item.source,
                inputs={**inputs, stage.output.name: own},
                attributes={name: view.shard.attributes for name, view in inputs.items()},
                load_mesh=partial(read_mesh, inputs["surfaces"]) if "surfaces" in inputs else None,
            )
        )
    return tasks


def _counts_of(stage: Stage) -> Any:
    """The stage's function in `pipeline.tuning.explanations`.

    Of an object stage: (settings, models by name: Mapping[str, Path], tasks) -> Iterable[Count]; of a dataset stage:
    (job) -> Iterable[Count].
    """
    return import_module(f"pipeline.tuning.explanations.{stage.name.replace('-', '_')}").explain


def _row(plan: Plan, object_id: str) -> Row | None:
    """The object's row: from the shard, or, where that is not up to date, from its piece; None where it failed."""
    if plan.up_to_date():
        shard = Shard(plan.path, plan.request.stage.output)
        return None if shard.failure(object_id) else shard.view(object_id).row()
    piece = next((plan.piece(job) for job in plan.jobs if job.item.object_id == object_id), None)
    return piece.row if piece is not None and piece.ok else None
