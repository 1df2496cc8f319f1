"""Memory of workers stays flat over many objects."""

import os
from pathlib import Path

from pipeline.config.manifest import load_manifest
from pipeline.console import errors
from pipeline.engine.executor import Work
from pipeline.engine.make import plans
from pipeline.engine.plan import Request
from pipeline.engine.worker_processes import WorkerProcesses
from stages.registry import GRASP_STAGES, load_stage, resolve

ASSIGNMENTS = [
    *("sample-surfaces.points=1000", "simulate-grasps.attempts=5", "simulate-grasps.ik_samples=256", "render-vision.resolution=64"),
    *("simulate-slides.slides=1", "simulate-slides.steps=8", "simulate-slides.rate=4", "simulate-slides.pixels=40"),
    *("train-unet.width=2", "train-unet.epochs=1", "fit-charts.max_iterations=10"),
]
GROWTH_MB = 30
"""Less than 0.1 MB per object: below every known leak of these libraries (0.2 and 13 MB)."""


def usage_of_children() -> dict[str, float]:
    """Measure the resident memory of this process's children, in MB, and count their open files."""
    megabytes, files = 0.0, 0
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
            if int(fields["PPid"]) == os.getpid() and "VmRSS" in fields:
                megabytes += int(fields["VmRSS"].split()[0]) / 1024
                files += len(list((status.parent / "fd").iterdir()))
        except OSError:  # it has ended meanwhile
            continue
    return {"megabytes": megabytes, "files": files}


def test_memory_and_open_files_stay_flat_over_300_objects_in_every_object_stage(tmp_path):
    objects = load_manifest("pybullet-objects").objects()[:300]
    for name in GRASP_STAGES:
        stage = load_stage(name)
        if not stage.per_object and name != "train-unet":  # fit-charts reads its model
            continue
        (plan,) = plans(Request(stage, resolve(name, "draft", ASSIGNMENTS), "300", objects, "draft", 0, tmp_path))
        if stage.per_object:
            units, work = (
                [unit for unit in plan.units if not unit.failure],
                Work(stage, plan.settings, tmp_path, plan.model_digests, plan.assets),
            )
            with WorkerProcesses(1) as executor:
                usage = [usage_of_children() for _ in executor.run(work, units)]
            print(f"{name}: {usage[49]} at object 50, {usage[-1]} at object {len(usage)}")
            assert usage[-1]["megabytes"] - usage[49]["megabytes"] < GROWTH_MB
            assert usage[-1]["files"] <= usage[49]["files"]
        plan.make(errors)
