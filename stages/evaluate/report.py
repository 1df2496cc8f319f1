"""The evaluation's files: `tables.zarr` with every table and every value, and the tables again as `metrics.json`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.engine.stage import DatasetJob
from pipeline.kernels.metrics.cloud_distances import sampled_area, sampling_floor
from pipeline.models.reconstruction import Reconstructor
from stages.evaluate import tables
from stages.evaluate.measure import THRESHOLDS
from stages.evaluate.settings import EvaluationSettings
from stages.evaluate.store import TABLES_ZARR, Arrays, write_tables
from stages.evaluate.truth import Truth

METRICS = "metrics.json"

Facts = Mapping[str, Mapping[str, Any]]
"""By configuration: the facts of the record of its training."""

VALUES = ("grasps_given", "chamfer", "precision", "recall", "f1", "local_chamfer", "local_points")
PREDICTIONS = ("vertices", "faces", "position", "first_grasp")


def write_report(job: DatasetJob, truth: Truth, found: Mapping[str, Arrays], models: Mapping[str, Reconstructor], facts: Facts) -> None:
    """Write the files into the job's folder; `found` is what `measure` found, by configuration."""
    settings: EvaluationSettings = job.settings
    summaries = _summaries(job, truth, found, models, facts)
    attributes = {
        "settings": settings.results(),
        "seed": job.seed,
        "split": truth.rows.split,
        "configurations": {name: {"image": model.image, "touch": model.touch} for name, model in models.items()},
        "left_out": truth.rows.left_out,
    }
    write_tables(job.folder / TABLES_ZARR, summaries | _values(truth, found, settings), attributes)
    plain = {name: {key: _plain(value.tolist()) for key, value in table.items()} for name, table in summaries.items()}
    content = {**attributes, "tables": plain}
    (job.folder / METRICS).write_text(json.dumps(content, indent=2, sort_keys=True, allow_nan=False))


def _summaries(
    job: DatasetJob, truth: Truth, found: Mapping[str, Arrays], models: Mapping[str, Reconstructor], facts: Facts
) -> dict[str, Arrays]:
    """Every table but the values an object."""
    settings: EvaluationSettings = job.settings
    area = np.array([sampled_area(points) for points in map(truth.points, range(len(truth)))])
    objects: Arrays = {
        "object_id": tables.names(truth.rows.object_ids),
        "category": tables.names(truth.rows.categories),
        "area": area,
        "floor": np.array([sampling_floor(one, settings.points) for one in area]),
    }
    tau = settings.tau * np.array(THRESHOLDS)
    made = {
        "objects": objects,
        "table_1": tables.dataset(job.data),
        "table_2": tables.rings(found, job.seed),
        "modalities": tables.modalities(found, objects, tau, job.seed),
        "training": tables.training(facts),
    }
    if taking := {name: arrays for name, arrays in found.items() if models[name].touch}:
        made["table_3"] = tables.grasps(taking, job.seed)
        made["charts"] = tables.charts(*(truth.charts(name) for name in ("residual", "iterations", "stop_rule")))
    return made


def _values(truth: Truth, found: Mapping[str, Arrays], settings: EvaluationSettings) -> dict[str, Arrays]:
    """The groups `values` and `predictions` of every configuration."""
    object_id, category = tables.names(truth.rows.object_ids), tables.names(truth.rows.categories)
    ring = np.arange(1, settings.rings + 1)
    groups: dict[str, Arrays] = {}
    for name, arrays in found.items():
        values = {key: arrays[key] for key in VALUES}
        groups[f"values/{name}"] = {"object_id": object_id, "category": category, "ring": ring, **values}
        predictions = {key: arrays[key] for key in PREDICTIONS}
        groups[f"predictions/{name}"] = {"object_id": object_id, "grasps_given": arrays["case_grasps"], **predictions}
    return groups


def _plain(value: Any) -> Any:
    """JSON has no infinity: an interval without an end has null there."""
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and math.isinf(value) else value
