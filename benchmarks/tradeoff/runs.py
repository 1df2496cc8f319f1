"""Make variants: each in a data directory of its own, which shares what it does not vary with its study's common one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.tradeoff.study_plan import HERE, StudyPlan, Variant
from pipeline.config.manifest import load_manifest
from pipeline.engine.keys import code_hash
from pipeline.engine.stage import DatasetStage
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Place
from pipeline.tradeoff.measurements import Measurement, Provenance, Study
from pipeline.tradeoff.sweep import file_name
from schemas.catalogue import ARTIFACTS
from stages.registry import load_stage

COMMON = "common"
VT_PIPELINE = str(Path(sys.executable).parent / "vt-pipeline")
SHARED = ("surfaces", "grasps", "vision", "touch", "models/unet", "charts", "models/gcn")
"""What a variant's directory links to, up to what the variant makes."""
MADE_BY = {
    "sample-surfaces": "surfaces",
    "simulate-grasps": "grasps",
    "render-vision": "vision",
    "simulate-touch": "touch",
    "train-unet": "models/unet",
    "fit-charts": "charts",
    "train-gcn": "models/gcn",
    "evaluate": "evaluation",
}


class CommandError(Exception):
    """A `vt-pipeline` command failed; the message is what it printed."""


def command(
    stage: str, manifest: Path, preset: str, data: Path, assignments: list[str], seed: int | None = None, more: list[str] | None = None
) -> None:
    """`vt-pipeline run`, on one core unless `more` says otherwise; a `CommandError` where it fails."""
    line = [VT_PIPELINE, "run", stage, "--manifest", str(manifest), "--preset", preset]
    line += ["--data", str(data), *(more or ["--workers", "1"]), *(part for assignment in assignments for part in ("--set", assignment))]
    line += [] if seed is None else ["--seed", str(seed)]
    done = subprocess.run(line, capture_output=True, text=True)
    if done.returncode:
        raise CommandError(f"{' '.join(line)}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def prepare(root: Path, objects: str, steps: dict[str, list[str]], preset: str) -> Path:
    """Make the common data directory of the studies of some objects: the given stages, each with its assignments."""
    data = root / objects / COMMON
    for stage, assignments in steps.items():
        command(stage, HERE / f"{objects}.yaml", preset, data, assignments)
    return data


@dataclass(frozen=True)
class Made:
    """A variant as made.

    `seconds` are an object's, or the whole training's; `kilobytes` an object's, or the whole folder's; `facts` what a set
    stage recorded.
    """

    data: Path
    seconds: float
    kilobytes: float
    facts: dict[str, Any]


def link_common(objects: Path, data: Path, own: str) -> None:
    """Make a data directory that shares with the common one of its objects whatever comes before `own`."""
    for name in SHARED[: SHARED.index(own)] if own in SHARED else SHARED:
        common, link = (objects / COMMON / name).resolve(), data / name
        if common.exists() and not link.exists():
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(common)


def make(root: Path, plan: StudyPlan, variant: Variant) -> Made:
    """Make a variant unless it is up to date; its cost is that of when it was made."""
    data = root / plan.objects / plan.name.replace(" ", "-") / file_name(variant.label)
    own = MADE_BY[plan.stage]
    link_common(root / plan.objects, data, own)
    command(plan.stage, plan.manifest, variant.preset, data, variant.assignments(plan.stage), variant.seed)
    return _of_folder(data, plan, variant) if isinstance(load_stage(plan.stage), DatasetStage) else _of_shard(data, own)


def _of_shard(data: Path, artifact: str) -> Made:
    shard = DataDirectory(data).collection(ARTIFACTS[artifact]).first
    seconds = [row.seconds for row in shard.record.rows]
    return Made(data, sum(seconds) / len(seconds), _bytes(shard.path) / 1e3 / len(seconds), {})


def _of_folder(data: Path, plan: StudyPlan, variant: Variant) -> Made:
    stage: Any = load_stage(plan.stage)
    name, directory = stage.writes(variant.settings(plan.stage)), DataDirectory(data)
    record, folder = directory.folder(name), directory.folder_path(name)
    weights = sum(path.stat().st_size for path in folder.glob("*.safetensors"))
    return Made(data, float(record.facts.get("training_seconds", record.seconds)), (weights or _bytes(folder)) / 1e3, dict(record.facts))


def _bytes(folder: Place) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def study(plan: StudyPlan, made: Mapping[str, str], measurements: Sequence[Measurement]) -> Study:
    """Describe what was measured of a plan, with the code that was measured."""
    stage, items = load_stage(plan.stage), load_manifest(str(plan.manifest)).objects(None)
    whole, split = isinstance(stage, DatasetStage), "test" if plan.stage == "evaluate" else "train"
    return Study(
        name=plan.name,
        stage=plan.stage,
        objects=sum(item.split == split for item in items) if whole else len(items),
        whole_dataset=whole,
        costs=plan.costs,
        provenance=Provenance(**made, code=code_hash(stage)),
        measurements=tuple(measurements),
        fixed=plan.fixed,
        varied_at=plan.varied_at,
        skipped=plan.skipped,
    )
