"""How fast this machine is at a stage: a few objects made for real, in a directory of their own, or one epoch learned from them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.engine.folders import fill, plan_folder
from pipeline.engine.plan import Request, make_plan
from pipeline.engine.runner import execute
from pipeline.engine.stage import ObjectStage, SetStage
from pipeline.errors import StoreError
from pipeline.store.record import Record
from pipeline.store.shard import Shard


class Probed(NamedTuple):
    """Mean seconds of an object, on one core; of packing its row; and of the run beside them."""

    seconds: float
    packing: float
    beside: float


def probe(request: Request[ObjectStage], objects: Sequence[Object]) -> Probed:
    """Make some of a request's objects, and see what takes how long.

    Raises
    ------
    StoreError
        None of them can be made: with the first one's reason.
    """
    began = time.perf_counter()
    plan = make_plan(replace(request, objects=objects), 0)
    made = began
    for _ in execute(plan):
        made = time.perf_counter()
    wall, packing = time.perf_counter() - began, time.perf_counter() - made
    shard = Shard(plan.path, request.stage.output)
    failures = shard.attributes["failures"]
    if len(failures) == len(objects):
        first = next(iter(failures))
        raise StoreError(f"none of {len(objects)} objects tried can be made; {first}: {failures[first]['reason']}")
    seconds = [float(value) for value in shard.attributes["seconds"]]
    busy = sum(seconds) / min(request.workers, len(objects))
    return Probed(sum(seconds) / len(seconds), packing / len(seconds), max(0.0, wall - busy - packing))


def probe_training(request: Request[SetStage], objects: Sequence[Object], console: Console) -> tuple[float, float]:
    """Train for one epoch on some objects; seconds of it for each that is learned from, and the seconds of the run beside."""
    began = time.perf_counter()
    settings: Any = request.settings.model_copy(update={"epochs": 1})
    plan = plan_folder(replace(request, objects=objects, settings=settings))
    fill(plan, console)
    seconds = float(Record(plan.path).content["facts"]["training_seconds"])
    return seconds / sum(item.split == "train" for item in objects), time.perf_counter() - began - seconds


def some_of(objects: Sequence[Object], count: int) -> list[Object]:
    """About so many objects, spread evenly, the last of them to validate on and the others to learn from."""
    chosen = objects[:: max(1, len(objects) // count)]
    splits = ["train"] * (len(chosen) - 1) + ["valid"]
    return [Object(one.object_id, one.category, split, one.source) for one, split in zip(chosen, splits, strict=True)]
