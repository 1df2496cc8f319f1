"""The tables of an evaluation, from the values per object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.touch_charts import is_surface
from pipeline.dataset.touch_statistics import tally
from pipeline.engine.stage import DatasetJob
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.kernels.metrics.cloud_distances import sampling_floor
from pipeline.rng import numpy_rng
from pipeline.store.storage import Place
from schemas.charts import STOP_RULES
from schemas.evaluation import QUALITY
from stages.evaluate.baselines import retrieved
from stages.evaluate.evaluation_files import Arrays
from stages.evaluate.ground_truth import Truth
from stages.evaluate.measure import THRESHOLDS
from stages.evaluate.settings import EvaluationSettings

Models = Mapping[str, Arrays]
"""By configuration: the arrays of its group `values`."""

Facts = Mapping[str, Mapping[str, Any]]
"""By configuration: the facts of the record of its training."""

TableArrays = dict[str, Any]
"""Arrays, or lists of numbers or names, as the schema declares them."""

ALL = "all"
"""The class of every object, the stop rule of every chart."""


def make_tables(
    job: DatasetJob, truth: Truth, models: Models, *, felt: Sequence[str], facts: Facts, shut: Models
) -> dict[str, TableArrays]:
    """Make every table of the schema; those of touch only for the configurations that take it, `felt`; `shut` has groups `closed`."""
    settings: EvaluationSettings = job.settings
    areas = [truth.area(row) for row in range(len(truth))]
    objects = {
        "object_id": truth.rows.object_ids,
        "category": truth.rows.categories,
        "area": areas,
        "floor": np.array([sampling_floor(area, truth.count) for area in areas]),
    }
    made = {
        "objects": objects,
        "table_1": dataset(job.data),
        "table_2": rings(models, job.seed),
        "modalities": modalities(models, objects, settings.tau * np.array(THRESHOLDS), job.seed),
        "training": training(facts),
        "quality": quality(models),
    }
    if known := retrieved(truth, job):
        made["baselines"] = baselines(known, objects, job.seed)
    if shut:
        made["closed_surfaces"] = closed_surfaces(shut)
    if felt:
        made["table_3"] = grasps({name: models[name] for name in felt}, job.seed)
        made["charts"] = charts(*map(truth.stack, ("residual", "iterations", "stop_rule")))
    return made


def dataset(data: Place) -> TableArrays:
    """Make Table 1, one row per class and one for all."""
    found = tally(data)
    *counts, percent = np.array([entry.row()[:4] for entry in found.values()]).T  # (class,) each
    successful, touches = percent / 100, counts[-1]
    return {
        "category": [*found, ALL],
        **{name: [*column, column.sum()] for name, column in zip(("objects", "grasps", "touches"), counts, strict=True)},
        "successful": [*successful, (successful * touches).sum() / touches.sum()],
    }


def per_object(values: Arrays, given: int) -> NDArray[np.float64]:
    """Compute the (object,) Chamfer distance with `given` grasps, mean over the first ones."""
    place = int(np.flatnonzero(values["grasps_given"] == given)[0])
    return np.asarray(values["chamfer"][:, :, place].mean(axis=1))


def ring_per_object(values: Arrays, ring: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Compute the (object,) local Chamfer distance in a ring (0 the innermost), mean over the sites with points in it; count these.

    Where the number is 0 there is no value, and the distance is 0.
    """
    count = values["local_points"][..., ring] > 0  # (object, grasp, sensor)
    sites = count.sum(axis=(1, 2))
    total = np.where(count, values["local_chamfer"][..., ring], 0).sum(axis=(1, 2))
    return total / np.maximum(sites, 1), sites


def rings(models: Models, seed: int) -> TableArrays:
    """Make Table 2."""
    ring = next(iter(models.values()))["ring"]
    found = {name: [ring_per_object(values, place) for place in range(len(ring))] for name, values in models.items()}
    sites = np.array([[sites for _, sites in columns] for columns in found.values()])  # (configuration, ring, object)
    samples = {name: {place: means[sites > 0] for place, (means, sites) in enumerate(columns)} for name, columns in found.items()}
    return {
        "configuration": [*models],
        "ring": ring,
        **_means("local_chamfer", samples, partial(numpy_rng, seed, "table_2")),
        "objects": np.count_nonzero(sites, axis=-1),
        "sites": sites.sum(axis=-1),
    }


def grasps(models: Models, seed: int) -> TableArrays:
    """Make Table 3, of models that take touch."""
    given = next(iter(models.values()))["grasps_given"].tolist()
    samples = {name: {number: per_object(values, number) for number in given} for name, values in models.items()}
    return {"configuration": [*models], "grasps_given": given, **_means("chamfer", samples, partial(numpy_rng, seed, "table_3"))}


def modalities(models: Models, objects: TableArrays, tau: NDArray[np.float64], seed: int) -> TableArrays:
    """Compare the models with one grasp, by class and overall; `objects` is the group of that name."""
    members = _members(objects)
    samples = {name: {kind: per_object(values, 1)[member] for kind, member in members.items()} for name, values in models.items()}
    f1 = [values["f1"][:, :, 0].mean(axis=1) for values in models.values()]  # (object, threshold) each
    return {
        "configuration": [*models],
        "category": [*members],
        "objects": [member.sum() for member in members.values()],
        "floor": [objects["floor"][member].mean() for member in members.values()],
        "tau": tau,
        **_means("chamfer", samples, partial(numpy_rng, seed, "modalities")),
        "f1": [[values[member].mean(axis=0) for member in members.values()] for values in f1],
        "median": [[np.median(values) for values in row.values()] for row in samples.values()],
    }


def quality(models: Models) -> TableArrays:
    """Summarise how the reconstructions of the models look."""
    figures = np.array([[values[name] for name in QUALITY] for values in models.values()])  # (configuration, measure, object)
    return {"configuration": [*models], "measure": [*QUALITY], "mean": figures.mean(axis=-1), "median": np.median(figures, axis=-1)}


def closed_surfaces(models: Models) -> TableArrays:
    """Summarise the closed meshes of the models' reconstructions, from their groups `closed`."""
    shared = [values["iou"][values["has_inside"]] for values in models.values()]
    return {
        "configuration": [*models],
        "watertight": [values["watertight"].mean() for values in models.values()],
        "objects": [len(values) for values in shared],
        "mean": [_mean(values) for values in shared],
        "median": [np.median(values) if len(values) else 0.0 for values in shared],
    }


def baselines(found: Mapping[str, NDArray[np.float64]], objects: TableArrays, seed: int) -> TableArrays:
    """Summarise the (object,) Chamfer distances of what is looked up, by class and overall; `objects` is the group of that name."""
    members = _members(objects)
    samples = {name: {kind: distances[member] for kind, member in members.items()} for name, distances in found.items()}
    return {
        "baseline": [*found],
        "category": [*members],
        **_means("chamfer", samples, partial(numpy_rng, seed, "baselines")),
        "median": [[np.median(values) for values in row.values()] for row in samples.values()],
    }


def _members(objects: TableArrays) -> dict[str, NDArray[np.bool_]]:
    """Which objects are of each class, and of all."""
    category = np.array(objects["category"])
    return {str(name): category == name for name in np.unique(category)} | {ALL: np.full(len(category), True)}


def _means(name: str, samples: Mapping[str, Mapping[Any, NDArray[np.float64]]], rng: Callable[..., np.random.Generator]) -> Arrays:
    """Compute means over objects and their intervals, by configuration and column; 0 where there is no object."""
    nothing = Interval(0.0, 0.0, 0.0, 0)
    found = [
        [astuple(mean_interval(values, rng(model, column)) if len(values) else nothing) for column, values in row.items()]
        for model, row in samples.items()
    ]
    mean, low, high, _ = np.moveaxis(np.array(found), -1, 0)
    return {name: mean, "low": low, "high": high}


def charts(residual: np.ndarray, iterations: np.ndarray, stop_rule: np.ndarray) -> TableArrays:
    """Summarise touch-chart residuals by stop rule, from the arrays of the artifact `charts`."""
    chosen = {name: stop_rule == code for code, name in enumerate(STOP_RULES) if name != "no_touch" and (stop_rule == code).any()}
    chosen[ALL] = is_surface(stop_rule)
    return {
        "stop_rule": [*chosen],
        "charts": [mask.sum() for mask in chosen.values()],
        "residual_mean": [_mean(residual[mask]) for mask in chosen.values()],
        "residual_worst": [residual[mask].max(initial=0) for mask in chosen.values()],
        "iterations": [_mean(iterations[mask]) for mask in chosen.values()],
    }


def _mean(values: np.ndarray) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else 0.0


def training(facts: Facts) -> TableArrays:
    """List what each model's training came to; seconds and hardware stay in its record, for no digest holds them."""
    rows = facts.values()
    return {
        "configuration": [*facts],
        "parameters": [row["parameters"] for row in rows],
        "epochs": [row["epochs"] for row in rows],
        "best_epoch": [row["best_epoch"] + 1 for row in rows],
        "best_loss": [row["best"]["loss"] for row in rows],
    }
