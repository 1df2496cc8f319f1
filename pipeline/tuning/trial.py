"""Measure how fast this machine runs a stage: make a few objects in a directory of their own, or train for one epoch."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.engine.folders import fill, plan_folder
from pipeline.engine.plan import Request, make_plan
from pipeline.engine.runner import execute
from pipeline.engine.stage import ObjectStage, SetStage
from pipeline.errors import StoreError
from pipeline.store.record import Record
from pipeline.store.shard import Shard
from pipeline.tuning.choice import Choice, MachineSpeed
from stages.registry import is_set_stage


def measure_speed(request: Request[Any], choice: Choice, console: Console) -> MachineSpeed:
    """Run a stage on the request's objects, at the settings of a choice.

    Raises
    ------
    StoreError
        None of the objects can be made; the message says why the first cannot.
    """
    if is_set_stage(request.stage):
        return _train_one_epoch(cast(Request[SetStage], request), choice, console)
    return _make_objects(cast(Request[ObjectStage], request), choice)


def trial_objects(objects: Sequence[Object], count: int) -> list[Object]:
    """Choose about `count` objects, spread evenly, the last of them for validation and the others for training."""
    chosen = objects[:: max(1, len(objects) // count)]
    splits = ["train"] * (len(chosen) - 1) + ["valid"]
    return [Object(one.object_id, one.category, split, one.source) for one, split in zip(chosen, splits, strict=True)]


def _make_objects(request: Request[ObjectStage], choice: Choice) -> MachineSpeed:
    began = time.perf_counter()
    plan = make_plan(request, 0)
    made = began
    for _ in execute(plan):
        made = time.perf_counter()
    wall, packing = time.perf_counter() - began, time.perf_counter() - made
    shard = Shard(plan.path, request.stage.output)
    failures = shard.attributes["failures"]
    if len(failures) == len(request.objects):
        first = next(iter(failures))
        raise StoreError(f"none of {len(request.objects)} objects tried can be made; {first}: {failures[first]['reason']}")
    seconds = [float(value) for value in shard.attributes["seconds"]]
    busy = sum(seconds) / min(request.workers, len(request.objects))
    measured = choice.measurement
    return MachineSpeed(
        factor=sum(seconds) / len(seconds) / measured.seconds,
        startup=max(0.0, wall - busy - packing),
        packing=packing / len(seconds) / measured.kilobytes,
    )


def _train_one_epoch(request: Request[SetStage], choice: Choice, console: Console) -> MachineSpeed:
    began = time.perf_counter()
    settings: Any = request.settings
    plan = plan_folder(replace(request, settings=settings.model_copy(update={"epochs": 1})))
    fill(plan, console)
    epoch = float(Record(plan.path).content["facts"]["training_seconds"])
    startup = time.perf_counter() - began - epoch
    per_object = settings.epochs * epoch / sum(item.split == "train" for item in request.objects)
    return MachineSpeed(factor=per_object * choice.study.objects / choice.measurement.seconds, startup=startup)
