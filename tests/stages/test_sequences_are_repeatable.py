"""Slides and lifts have the same bytes from one process, from two, and from a run that was stopped and continued."""

import shutil
from pathlib import Path
from pkgutil import resolve_name

import pytest

from pipeline.console import errors
from pipeline.engine.executor import Executor, Serial
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS
from stages.registry import load_stage, resolve
from tests.stages.lifted_objects import coarse_gel, lift_assignments
from tests.stages.tiny_dataset import ASSIGNMENTS, manifest, run_stage

SLIDES = ("simulate-slides.slides=1", "simulate-slides.steps=8", "simulate-slides.rate=4", "simulate-slides.pixels=32")
COMPUTED = {"simulate-slides": "stages.simulate_slides._slide", "simulate-touch": "stages.simulate_touch._lift"}


@pytest.fixture(scope="module")
def assignments(tmp_path_factory) -> tuple[str, ...]:
    return (*ASSIGNMENTS, *SLIDES, *lift_assignments(coarse_gel(tmp_path_factory.mktemp("sensor"))))


@pytest.fixture(scope="module")
def grasped(assignments, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("grasped")
    for stage in ("sample-surfaces", "simulate-grasps"):
        run_stage(folder, stage, manifest(), *assignments)
    return folder


@pytest.mark.parametrize("name", COMPUTED)
def test_bytes_depend_on_neither_workers_nor_interruptions(name, assignments, grasped, tmp_path, monkeypatch):
    stage, objects = load_stage(name), manifest()
    settings = resolve(name, "draft", assignments)

    def run(folder: str, executor: Executor | None = None) -> str:
        data = tmp_path / folder
        if not data.exists():
            shutil.copytree(grasped, data)
        make(Request(stage, settings, objects.name, objects.objects(), "draft", 0, data, executor=executor or Serial()), errors)
        return DataDirectory(data).collection(ARTIFACTS[stage.output.name]).digest()

    whole = run("whole")
    with WorkerProcesses(2) as workers:
        assert run("shared", workers) == whole
    with monkeypatch.context() as patched:
        compute, calls = resolve_name(COMPUTED[name].replace("._", ":_")), []

        def stopped(*args: object) -> object:
            if calls:
                raise KeyboardInterrupt
            calls.append(args)
            return compute(*args)

        patched.setattr(COMPUTED[name], stopped)
        with pytest.raises(KeyboardInterrupt):
            run("stopped")
    assert len([*(tmp_path / "stopped").glob(".work/*/rows/*/*.row")]) == 1  # the first object was kept
    assert run("stopped") == whole
