"""`vt-pipeline run STAGE --explain`: what was modelled, what was left out, and why, as a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
from rich.markup import escape
from rich.table import Table

from pipeline.console import console, say
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.folders import plan_folder
from pipeline.engine.plan import Plan, Request
from pipeline.engine.stage import SetJob, SetStage, Task
from pipeline.store.collection import Collection
from pipeline.store.pieces import Row
from pipeline.store.shard import Shard
from pipeline.tuning.explain import Part, shards_opened, total
from pipeline.tuning.explanations import load_explanation

OBJECTS = 4
"""Objects of a shard that are counted, spread evenly: a second or so each."""
NUMBERS = ("modelled", "left out", "%")


def explain_shard(plan: Plan) -> None:
    """Explain a shard that has just been made, or was up to date, on a few of its objects; with `only`, on that one."""
    request, stage = plan.request, plan.request.stage
    tasks = _tasks(plan)
    if not tasks:
        if request.only is None:  # else it is in another shard, or failed, and that has been said
            say(f"{stage.name} {plan.path}: {'every object failed' if plan.jobs else 'no objects'}, there is nothing to explain")
        return
    chosen = [tasks[place] for place in np.unique(np.linspace(0, len(tasks) - 1, OBJECTS).astype(int))]
    models = {name: record.folder for name, record in plan.records.items()}
    parts = [*load_explanation(stage.name)(request.settings, models, chosen), shards_opened(stage, request.settings, request.data)]
    named = ", ".join(task.object_id for task in chosen)
    _show(f"{stage.name} {plan.path}: counted on {len(chosen)} of {len(plan.jobs)} objects ({named})", parts)


def explain_folder(request: Request[SetStage]) -> None:
    """Explain a folder that a set stage has just filled, or that was up to date."""
    plan, stage = plan_folder(request), request.stage
    models = {name: record.folder for name, record in plan.records.items()}
    job = SetJob(request.data, plan.path, request.settings, request.seed, models, console)
    parts = [*load_explanation(stage.name)(job), shards_opened(stage, request.settings, request.data)]
    _show(f"{stage.name} {plan.path}: counted on its objects", parts)


def _tasks(plan: Plan) -> Sequence[Task]:
    """The tasks of the shard's objects that were processed, with the stage's own row among the inputs."""
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


def _row(plan: Plan, object_id: str) -> Row | None:
    """The object's row: from the shard, or, where that is of other settings or not packed yet, from its piece; None where it failed."""
    if plan.up_to_date():
        shard = Shard(plan.path, plan.request.stage.output)
        return None if shard.failure(object_id) else shard.view(object_id).row()
    piece = next((plan.piece(job) for job in plan.jobs if job.item.object_id == object_id), None)
    return piece.row if piece is not None and piece.ok else None


def _show(title: str, parts: Iterable[Part]) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("", "modelled", "left out", "%", "why it was left out", "shortcut"):
        table.add_column(name, justify="right" if name in NUMBERS else "left")
    for part in total(parts):
        whole = part.modelled + part.left_out
        share = f"{100 * part.left_out / whole:.0f}" if whole else "–"
        why = escape(part.why) if part.left_out else ""
        table.add_row(escape(part.what), f"{part.modelled:,}", f"{part.left_out:,}", share, why, part.shortcut)
    say(title)
    console.print(table)
