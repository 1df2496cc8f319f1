"""Measure how fast this machine runs a stage: make a few objects in a directory of their own, or train for one epoch."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.engine.plan import Request
from pipeline.engine.run import make_plans, run
from pipeline.engine.stage import DatasetStage
from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import FolderOutput
from pipeline.tradeoff.choice import Choice, MachineSpeed


def measure_speed(request: Request[Any], choice: Choice, console: Console) -> MachineSpeed:
    """Run a stage on the request's objects, at the settings of a choice.

    Parameters
    ----------
    request
        The run; of a training one epoch is done.
    choice
        The measurement to compare with.
    console
        Shows progress.

    Returns
    -------
    MachineSpeed
        Of this machine, relative to the measured one.

    Raises
    ------
    StoreError
        None of the objects can be made; the message says why the first cannot.
    """
    began, measured = time.perf_counter(), choice.measurement
    settings: Any = request.settings
    short = settings.model_copy(update={"epochs": 1}) if isinstance(request.stage, DatasetStage) else settings
    (plan,) = make_plans(replace(request, settings=short))
    result = run(plan, console)
    wall, directory = time.perf_counter() - began, DataDirectory(request.data)
    if isinstance(plan.output, FolderOutput):
        epoch = float(directory.folder(plan.units[0].name).facts["training_seconds"])
        per_object = settings.epochs * epoch / sum(item.split == "train" for item in request.objects)
        return MachineSpeed(factor=per_object * choice.study.objects / measured.seconds, startup=wall - epoch)
    rows = directory.collection(plan.output.artifact).first.record.rows
    failures = [row.failure for row in rows if row.failure]
    if len(failures) == len(rows):
        raise StoreError(f"none of {len(rows)} objects tried can be made; {rows[0].object_id}: {failures[0].reason}")
    seconds = sum(row.seconds for row in rows)
    return MachineSpeed(
        factor=seconds / len(rows) / measured.seconds,
        startup=max(0.0, wall - seconds / min(request.executor.processes, len(rows)) - result.publishing),
        publishing=result.publishing / len(rows) / measured.kilobytes,
    )


def trial_objects(objects: Sequence[Object], count: int) -> list[Object]:
    """Choose about `count` objects, spread evenly, the last of them for validation and the others for training."""
    chosen = objects[:: max(1, len(objects) // count)]
    return [*(replace(one, split="train") for one in chosen[:-1]), replace(chosen[-1], split="valid")]
