"""Check settings and options that only change speed: the digests of their outputs are equal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.tradeoff import runs
from benchmarks.tradeoff.study_plan import HERE
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS

TRIED: dict[str, dict[str, tuple[list[str], list[str]]]] = {
    "simulate-grasps": {
        "workers 1": (["--workers", "1"], []),
        "workers 2": (["--workers", "2"], []),
        "shards 3": (["--workers", "1", "--shards", "3"], []),
    },
    "train-gcn": {
        "checkpoint_passes=false": ([], ["checkpoint_passes=false"]),
        "checkpoint_passes=true": ([], ["checkpoint_passes=true"]),
        "checkpoint_seconds=0": ([], ["checkpoint_seconds=0"]),
    },
    "train-unet": {"checkpoint_seconds=120": ([], ["checkpoint_seconds=120"]), "checkpoint_seconds=0": ([], ["checkpoint_seconds=0"])},
}
"""By stage and label: options of `run`, and assignments."""
QUICK = {"train-gcn": ["epochs=2", "configuration=touch"], "train-unet": ["epochs=2"], "simulate-grasps": ["attempts=8"]}


def same_results(root: Path, console: Console) -> list[dict[str, Any]]:
    """One row per stage and label: seconds, and the digest of what was made."""
    rows = []
    for stage, tried in TRIED.items():
        objects = "few" if stage == "simulate-grasps" else "learning"
        for label, (options, assignments) in tried.items():
            data = root / objects / "same" / f"{stage} {label}".replace(" ", "-")
            runs.link_common(root / objects, data, runs.MADE_BY[stage])
            settings = [f"{stage}.{one}" for one in (*QUICK[stage], *assignments)]
            runs.command(stage, HERE / f"{objects}.yaml", "draft", data, settings, more=options)
            rows.append({"stage": stage, "label": label, **_seen(data, stage)})
            console.print(f"{stage} {label}: {rows[-1]['digest'][:12]}")
        if len({row["digest"] for row in rows if row["stage"] == stage}) > 1:
            raise RuntimeError(f"{stage}: a setting that must only change speed changed the output; see the digests above")
    return rows


def _seen(data: Path, stage: str) -> dict[str, Any]:
    name = "models/gcn/touch" if stage == "train-gcn" else runs.MADE_BY[stage]
    if name in ARTIFACTS:
        collection = DataDirectory(data).collection(ARTIFACTS[name])
        seconds = sum(row.seconds for shard in collection.shards for row in shard.record.rows)
        return {"seconds": round(seconds, 2), "digest": collection.digest()}
    record = DataDirectory(data).folder(name)
    return {"seconds": record.facts["training_seconds"], "digest": record.digest()}
