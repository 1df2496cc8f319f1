"""Small real data sets for the tests of learning, made by the stages themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.engine.folders import fill, plan_folder
from pipeline.engine.runner import execute

from pipeline.config.manifest import Manifest
from pipeline.config.presets import resolve
from pipeline.console import console_on
from pipeline.engine.plan import Request, make_plan
from pipeline.store.record import Record
from stages.registry import STAGES, is_dataset_stage, load_stage

ASSIGNMENTS = ("sample-surfaces.points=2000", "simulate-grasps.attempts=4", "simulate-grasps.ik_samples=512")


def manifest(train: int = 1, valid: int = 1, test: int = 0, **count: int) -> Manifest:
    """Modelled objects, in so many of each split."""
    source = {"kind": "procedural", "licence": "MIT", "seed": 0, "count": count or {"bottle": train + valid + test}}
    splits = {"train": train, "valid": valid, "test": test}
    return Manifest.model_validate({"name": "tiny", "description": "d", "seed": 0, "splits": splits, "sources": [source]})


def run_stage(data: Path, name: str, objects: Manifest, *assignments: str, seed: int = 0) -> Record | None:
    """Run a stage; the record, where it is a dataset stage."""
    stage = load_stage(name)
    settings = resolve(stage, "draft", [*ASSIGNMENTS, *assignments], STAGES)
    asked: Any = Request(stage, settings, objects.name, objects.objects(), "draft", seed, data)
    if is_dataset_stage(stage):
        plan = plan_folder(asked)
        if not plan.up_to_date():
            fill(plan, console_on(__import__("sys").stdout))
        return Record(plan.path)
    shard = make_plan(asked, 0)
    if not shard.up_to_date():
        for outcome in execute(shard):
            assert outcome.reason is None, outcome
    return None
