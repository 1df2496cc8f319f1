"""Measure what a cheaper dataset costs in the end: the Chamfer distance of a network trained and tested on it."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from benchmarks.tradeoff import runs
from benchmarks.tradeoff.errors import table_3
from benchmarks.tradeoff.study_plan import HERE
from pipeline.console import Meter
from pipeline.kernels.metrics.bootstrap import mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff.sweep import file_name
from schemas.catalogue import ARTIFACTS

MANIFEST = HERE / "learning.yaml"
STAGES = ("sample-surfaces", "simulate-grasps", "simulate-touch", "train-unet", "fit-charts", "train-gcn", "evaluate")
LEARNT = ["train-gcn.configuration=touch", "evaluate.configurations=[touch]"]
DATASETS: dict[str, list[str]] = {
    "draft": [],
    "twelve placements per object": ["simulate-grasps.attempts=12"],
    "hardly searched grasps": ["simulate-grasps.attempts=8", "simulate-grasps.ik_samples=256", "simulate-grasps.ik_refinements=0"],
    "depth in steps of 61 um": ["simulate-touch.gel_bits=14", "simulate-touch.far_bits=14"],
    "true depths, no U-Net": ["fit-charts.cloud='true'"],
}
"""What each sets beside `draft`; networks are draft's."""


def end_to_end(root: Path, console: Console) -> list[dict[str, Any]]:
    """One row per dataset: seconds per object before learning, touches, and the distance in the end."""
    with Meter(console, "end to end", len(DATASETS), "datasets") as meter, ThreadPoolExecutor(os.cpu_count()) as pool:

        def one(label: str) -> dict[str, Any]:
            data = root / "learning" / "end-to-end" / file_name(label)
            for stage in STAGES:
                if stage != "train-unet" or "true" not in label:
                    runs.command(stage, MANIFEST, "draft", data, [*LEARNT, *DATASETS[label]])
            meter.advance(label)
            return {"label": label, **_row(data)}

        return list(pool.map(one, DATASETS))


def _row(data: Path) -> dict[str, Any]:
    made = {name: DataDirectory(data).collection(ARTIFACTS[name]) for name in ("surfaces", "grasps", "touch")}
    seconds = [np.mean([row.seconds for row in shard.record.rows]) for collection in made.values() for shard in collection.shards]
    touched = np.mean([made["grasps"].view(name)["touch_success"].mean() for name in made["grasps"]])
    distances = TABLE_3_FACTOR * table_3(data)[0]
    interval = mean_interval(distances, numpy_rng(0, "end to end"))
    return {
        "seconds": round(float(sum(seconds)), 2),
        "touches": round(100 * float(touched), 1),
        "chamfer": round(float(distances.mean()), 3),
        "low": round(interval.low, 3),
        "high": round(interval.high, 3),
    }
