"""Measure how fast this machine runs a stage: make a few objects in a directory of their own, or train for one epoch."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.engine.plan import Request
from pipeline.engine.run import make_plans, run
from pipeline.engine.stage import DatasetStage, ObjectStage
from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory
from pipeline.tuning.choice import Choice, MachineSpeed
from stages.registry import is_dataset_stage


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
    if is_dataset_stage(request.stage):
        return _train_one_epoch(cast(Request[DatasetStage], request), choice, console)
    return _make_objects(cast(Request[ObjectStage], request), choice, console)


def trial_objects(objects: Sequence[Object], count: int) -> list[Object]:
    """Choose about `count` objects, spread evenly, the last of them for validation and the others for training."""
    chosen = objects[:: max(1, len(objects) // count)]
    splits = ["train"] * (len(chosen) - 1) + ["valid"]
    return [replace(one, split=split) for one, split in zip(chosen, splits, strict=True)]


def _make_objects(request: Request[ObjectStage], choice: Choice, console: Console) -> MachineSpeed:
    began = time.perf_counter()
    (plan,) = make_plans(request)
    result = run(plan, console)
    wall = time.perf_counter() - began
    rows = DataDirectory(request.data).collection(request.stage.output).first.record.rows
    failures = [row.failure for row in rows if row.failure]
    if len(failures) == len(request.objects):
        raise StoreError(f"none of {len(rows)} objects tried can be made; {rows[0].object_id}: {failures[0].reason}")
    seconds = [row.seconds for row in rows]
    busy = sum(seconds) / min(request.workers, len(request.objects))
    measured = choice.measurement
    return MachineSpeed(
        factor=sum(seconds) / len(seconds) / measured.seconds,
        startup=max(0.0, wall - busy - result.packing),
        packing=result.packing / len(seconds) / measured.kilobytes,
    )


def _train_one_epoch(request: Request[DatasetStage], choice: Choice, console: Console) -> MachineSpeed:
    began = time.perf_counter()
    settings: Any = request.settings
    one_epoch = settings.model_copy(update={"epochs": 1})
    (plan,) = make_plans(replace(request, settings=one_epoch))
    run(plan, console)
    epoch = float(DataDirectory(request.data).folder(request.stage.folder(one_epoch)).facts["training_seconds"])
    startup = time.perf_counter() - began - epoch
    per_object = settings.epochs * epoch / sum(item.split == "train" for item in request.objects)
    return MachineSpeed(factor=per_object * choice.study.objects / choice.measurement.seconds, startup=startup)
