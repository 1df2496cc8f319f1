"""A small dataset that runs through all stages in forked processes, into which faults are injected."""

import importlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import yaml
from rich.console import Console

from pipeline.config.manifest import load_manifest
from pipeline.engine.executor import Serial
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.engine.worker_processes import WorkerProcesses
from pipeline.store.directory import DataDirectory
from stages.registry import GRASP_STAGES, load_stage, resolve

SETTINGS = (
    *("sample-surfaces.points=500", "simulate-grasps.attempts=4", "simulate-grasps.ik_samples=128", "simulate-grasps.grasps=2"),
    *(
        "render-vision.resolution=64",
        "train-unet.width=2",
        "train-unet.epochs=2",
        "train-unet.batch_size=8",
        "fit-charts.max_iterations=20",
    ),
    *("simulate-presses.presses=2", "simulate-presses.pixels=40", "train-touch.width=2", "train-touch.epochs=2"),
    *("simulate-slides.slides=1", "simulate-slides.steps=8", "simulate-slides.rate=4", "simulate-slides.pixels=40"),
    *("train-gcn.configuration=touch", "train-gcn.epochs=2", "train-gcn.gcn_layers=3", "train-gcn.gcn_features=8"),
    *("train-gcn.batch_size=4", "train-gcn.loss_points=100", "checkpoint_seconds=0"),
    *("train-implicit.configuration=implicit-touch", "train-implicit.epochs=2", "train-implicit.features=8"),
    *("evaluate.configurations=[touch]", "evaluate.points=200", "evaluate.grasps=[1,2]"),
)
"""As small as the stages allow: faults concern the written files, not their quality."""


@dataclass(frozen=True)
class Sandbox:
    """A folder with the manifest and mesh files of a small dataset, its stages and their settings."""

    root: Path
    stages: tuple[str, ...] = tuple(GRASP_STAGES)
    settings: tuple[str, ...] = SETTINGS

    @property
    def manifest(self) -> Path:
        """Return the path of a manifest with one object per split: one from a file, two procedural."""
        return self.root / "small.yaml"

    @property
    def mesh(self) -> Path:
        """Return the path of the mesh file."""
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
        for name in GRASP_STAGES:
            load_stage(name)

    def only(self, *stages: str) -> Self:
        """Return a sandbox of these stages alone."""
        return replace(self, stages=stages)

    def make(self, data: Path, *, workers: int = 0, check: bool = False, retry: bool = False) -> None:
        """Run the stages."""
        described = load_manifest(str(self.manifest))
        for name in self.stages:
            with WorkerProcesses(workers) if workers else Serial() as executor:
                asked = Request(
                    stage=load_stage(name),
                    settings=resolve(name, "draft", self.settings),
                    manifest=described.name,
                    objects=described.objects(),
                    preset="draft",
                    seed=0,
                    data=data,
                    executor=executor,
                    check=check,
                    retry=retry,
                )
                make(asked, Console(stderr=True))

    def command(self, stage: str, data: Path) -> list[str]:
        """Return the arguments of `vt-pipeline` that run a stage as `make` does."""
        sets = [part for assignment in self.settings for part in ("--set", assignment)]
        return ["run", stage, "--manifest", str(self.manifest), "--data", str(data), "--workers", "1", *sets]

    def output(self, stage: str) -> str:
        """Return the artifact or folder that a stage makes."""
        return load_stage(stage).writes(resolve(stage, "draft", self.settings))


def digests(data: Path) -> dict[str, str]:
    """Compute the digest of every artifact and folder."""
    directory = DataDirectory(data)
    artifacts = {artifact.name: directory.collection(artifact).digest() for artifact in directory.artifacts()}
    return artifacts | {name: directory.folder(name).digest() for name in directory.folders()}


def remove(data: Path, names: Sequence[str]) -> None:
    """Delete artifacts and folders, as if they had never been made."""
    for name in names:
        for path in [*data.glob(f"{name}.json"), *data.glob(f"{name}-*"), data / name, data / ".work" / name]:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
