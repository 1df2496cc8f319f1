"""A small dataset through all stages, made again and again in forked processes that may be disturbed."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

from pipeline.config.manifest import load_manifest
from pipeline.engine.plan import Request
from pipeline.engine.run import make_plans
from pipeline.engine.run import run as run_plan
from pipeline.engine.stage import DatasetStage
from pipeline.errors import PipelineError
from pipeline.store.directory import DataDirectory, folder_digest
from stages.registry import STAGES, load_stage, resolve

SETTINGS = (
    *("sample-surfaces.points=500", "simulate-grasps.attempts=4", "simulate-grasps.ik_samples=128", "simulate-grasps.grasps=2"),
    *(
        "render-vision.resolution=64",
        "train-unet.width=2",
        "train-unet.epochs=2",
        "train-unet.batch_size=8",
        "fit-charts.max_iterations=20",
    ),
    *("train-gcn.configuration=touch", "train-gcn.epochs=2", "train-gcn.gcn_layers=3", "train-gcn.gcn_features=8"),
    *("train-gcn.batch_size=4", "train-gcn.loss_points=100", "checkpoint_seconds=0"),
    *("evaluate.configurations=[touch]", "evaluate.points=200", "evaluate.grasps=[1,2]"),
)
"""As small as the stages allow: a fault is about what is written, not about how good it is."""

OK, IN_WORDS, TRACEBACK = 0, 1, 2
"""How a run ends: as it should, with an error that says what to do, or with a traceback."""

HANGS = -signal.SIGALRM
"""The status of a run that had to be killed after `LIMIT` seconds."""
LIMIT = 300.0


@dataclass(frozen=True)
class End:
    """How a run ended: its status (negative: the signal that killed it), and what it printed."""

    status: int
    output: str


@dataclass(frozen=True)
class Sandbox:
    """A folder with the manifest and the mesh files of a small dataset, the stages that are run, and their settings."""

    root: Path
    stages: tuple[str, ...] = tuple(STAGES)
    settings: tuple[str, ...] = SETTINGS

    @property
    def manifest(self) -> Path:
        """One object from a file, two that are modelled: one per split."""
        return self.root / "small.yaml"

    @property
    def mesh(self) -> Path:
        """The file."""
        return self.root / "meshes" / "duck.obj"

    def prepare(self) -> None:
        """Write manifest and meshes, and import what the stages need, so that forked runs start at once."""
        self.mesh.parent.mkdir(parents=True)
        shipped = Path(str(importlib.import_module("pybullet_data").getDataPath()))
        for name in ("duck.obj", "duck.mtl", "duckCM.png"):
            shutil.copy(shipped / name, self.mesh.parent)
        sources = [
            {"kind": "directory", "licence": "zlib", "up": "y", "path": str(self.mesh.parent)},
            {"kind": "procedural", "licence": "MIT", "seed": 0, "count": {"bottle": 2}},
        ]
        splits = {"train": 1, "valid": 1, "test": 1}
        described = {"name": "small", "description": "for faults", "seed": 0, "splits": splits, "sources": sources}
        self.manifest.write_text(yaml.safe_dump(described))
        for name in STAGES:
            load_stage(name)

    def only(self, *stages: str) -> Sandbox:
        """The same with these stages alone."""
        return replace(self, stages=stages)

    def make(self, data: Path, *, workers: int = 0, check: bool = False, retry: bool = False) -> None:
        """Run the stages."""
        described = load_manifest(str(self.manifest))
        for name in self.stages:
            asked = Request(
                stage=load_stage(name),
                settings=resolve(name, "draft", self.settings),
                manifest=described.name,
                objects=described.objects(),
                preset="draft",
                seed=0,
                data=data,
                workers=workers,
                check=check,
                retry=retry,
            )
            for plan in make_plans(asked):
                if not plan.up_to_date():
                    run_plan(plan, Console(stderr=True))

    def command(self, stage: str, data: Path) -> list[str]:
        """The arguments of `vt-pipeline` that run a stage as `make` does."""
        sets = [part for assignment in self.settings for part in ("--set", assignment)]
        return ["run", stage, "--manifest", str(self.manifest), "--data", str(data), "--workers", "1", *sets]

    def output(self, stage: str) -> str:
        """The artifact or folder that a stage makes."""
        loaded = load_stage(stage)
        return loaded.folder(resolve(stage, "draft", self.settings)) if isinstance(loaded, DatasetStage) else loaded.output.name


def fork(work: Callable[[], object], log: Path) -> int:
    """Start a function in a process of its own, in a group of its own; what it prints goes to `log`."""
    log.write_text("")
    process = os.fork()
    if process:
        return process
    status = TRACEBACK
    try:
        os.setsid()
        with log.open("w") as opened:
            os.dup2(opened.fileno(), 1)
            os.dup2(opened.fileno(), 2)
        work()
        status = OK
    except SystemExit as error:
        status = int(error.code or 0)
    except PipelineError as error:
        print(f"error: {error}", file=sys.stderr)
        status = IN_WORDS
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def finish(process: int, log: Path, limit: float = LIMIT) -> End:
    """Wait for a process that `fork` started; one that hangs is killed."""
    deadline = time.monotonic() + limit
    while True:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return End(os.waitstatus_to_exitcode(status), log.read_text(errors="replace"))
        if time.monotonic() > deadline:
            os.killpg(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return End(HANGS, log.read_text(errors="replace"))
        time.sleep(0.005)


def run(work: Callable[[], object], log: Path) -> End:
    """Run a function in a process of its own to its end."""
    return finish(fork(work, log), log)


def answer(work: Callable[[], Any], log: Path) -> Any:
    """What a function returns, as JSON, in a process of its own: no thread of Zarr's is there when the next one is forked."""
    end = run(lambda: print(json.dumps(work())), log)
    if end.status != OK:
        raise RuntimeError(end.output.strip()[-600:])
    return json.loads(end.output.splitlines()[-1])


def digests(data: Path) -> dict[str, str]:
    """The digest of every artifact and folder."""
    directory = DataDirectory(data)
    artifacts = {artifact.name: directory.collection(artifact).digest() for artifact in directory.artifacts()}
    return artifacts | {name: folder_digest(directory.folder(name)) for name in directory.folders()}


def remove(data: Path, names: Sequence[str]) -> None:
    """Delete artifacts and folders, as if they had never been made."""
    for name in names:
        for path in [*data.glob(f"{name}.json"), *data.glob(f"{name}-*"), data / name, data / ".work" / name]:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
