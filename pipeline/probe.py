"""How fast this machine makes a stage's rows: a few objects, made for real in a directory of their own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from pipeline.manifest import Object
from pipeline.plan import Request, make_plan
from pipeline.runner import execute
from pipeline.stage import ObjectStage
from pipeline.store.shard import Shard, StoreError


def probe(request: Request[ObjectStage], objects: Sequence[Object]) -> tuple[float, float]:
    """Make some of a request's objects; their mean seconds, each on one core, and the seconds that the run took beside them.

    Raises
    ------
    StoreError
        None of them can be made: with the first one's reason.
    """
    began = time.perf_counter()
    plan = make_plan(replace(request, objects=objects), 0)
    for _ in execute(plan):
        pass
    wall = time.perf_counter() - began
    shard = Shard(plan.path, request.stage.output)
    failures = shard.attributes["failures"]
    if len(failures) == len(objects):
        first = next(iter(failures))
        raise StoreError(f"none of {len(objects)} objects tried can be made; {first}: {failures[first]['reason']}")
    seconds = [float(value) for value in shard.attributes["seconds"]]
    busy = sum(seconds) / min(request.workers, len(objects))
    return sum(seconds) / len(seconds), max(0.0, wall - busy)
