"""Memory stays flat: a worker that has processed many objects is no larger than one that has processed some."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pipeline.config.manifest import load_manifest
from pipeline.console import errors
from pipeline.engine.plan import Request
from pipeline.engine.run import make_plans, run
from pipeline.engine.workers import Work, run_jobs
from stages.registry import STAGES, load_stage, resolve

ASSIGNMENTS = ["sample-surfaces.points=1000", "simulate-grasps.attempts=5", "simulate-grasps.ik_samples=256"]
GROWTH_MB = 30
"""Less than a tenth of a megabyte an object: below every leak known of these libraries (0.2 and 13 MB)."""


def children_megabytes() -> float:
    """The resident memory of this process's children, in MB."""
    total = 0.0
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
        except OSError:  # it has ended meanwhile
            continue
        if int(fields["PPid"]) == os.getpid() and "VmRSS" in fields:
            total += int(fields["VmRSS"].split()[0]) / 1024
    return total


@pytest.mark.slow
def test_memory_stays_flat_over_300_objects(tmp_path):
    objects = load_manifest("pybullet-objects").objects()[:300]
    for name in STAGES:
        stage = load_stage(name)
        (plan,) = make_plans(Request(stage, resolve(name, "draft", ASSIGNMENTS), "300", objects, "draft", 0, tmp_path))
        jobs, work = [member.job for member in plan.members], Work(stage, plan.settings, 0, tmp_path, plan.models)
        sizes = [children_megabytes() for _ in run_jobs(work, jobs, 1)]
        run(plan, errors)
        print(f"{name}: {sizes[49]:.0f} MB at object 50, {sizes[-1]:.0f} MB at object {len(sizes)}")
        assert sizes[-1] - sizes[49] < GROWTH_MB
