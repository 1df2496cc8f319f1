"""Small real datasets for the tests of learning, made by the stages themselves."""

from pathlib import Path

from pipeline.config.manifest import Manifest
from pipeline.console import errors
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.store.directory import DataDirectory
from stages.registry import load_stage, resolve

ASSIGNMENTS = ("sample-surfaces.points=2000", "simulate-grasps.attempts=4", "simulate-grasps.ik_samples=512")


def manifest(train: int = 1, valid: int = 1, test: int = 0, **count: int) -> Manifest:
    """Modelled objects; the number of each split is given."""
    source = {"kind": "procedural", "licence": "MIT", "seed": 0, "count": count or {"bottle": train + valid + test}}
    splits = {"train": train, "valid": valid, "test": test}
    return Manifest.model_validate({"name": "tiny", "description": "d", "seed": 0, "splits": splits, "sources": [source]})


def run_stage(data: Path, name: str, objects: Manifest, *assignments: str, seed: int = 0) -> Path | None:
    """Run a stage; the folder, where it is a dataset stage."""
    stage = load_stage(name)
    settings = resolve(name, "draft", [*ASSIGNMENTS, *assignments])
    (made,) = make(Request(stage, settings, objects.name, objects.objects(), "draft", seed, data), errors)
    assert not made.failures
    return None if stage.per_object else DataDirectory(data).folder_path(stage.writes(settings))
