"""The tables of an evaluation, from the values an object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.touch_charts import is_surface
from pipeline.dataset.touch_statistics import tally
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.rng import numpy_rng
from schemas.charts import STOP_RULES
from stages.evaluate.store import Arrays

Models = Mapping[str, Arrays]
"""By configuration: the arrays of its group `values`."""

ALL = "all"
"""The class of every object, the stop rule of every chart."""


def names(values: Sequence[str]) -> np.ndarray:
    """Names as the store keeps them."""
    return np.array(values, object)


def dataset(data: Path) -> Arrays:
    """Table 1, a row a class and one for all."""
    found = tally(data)
    rows = [entry.row()[:4] for entry in found.values()]
    objects, grasps, touches, percent = (np.array(column) for column in zip(*rows, strict=True))
    successful = percent / 100
    return {
        "category": names([*found, ALL]),
        "objects": np.append(objects, objects.sum()),
        "grasps": np.append(grasps, grasps.sum()),
        "touches": np.append(touches, touches.sum()),
        "successful": np.append(successful, (successful * touches).sum() / touches.sum()),
    }


def per_object(values: Arrays, given: int) -> NDArray[np.float64]:
    """(object,) Chamfer distance with `given` grasps, mean over the first ones."""
    place = int(np.flatnonzero(values["grasps_given"] == given)[0])
    return np.asarray(values["chamfer"][:, :, place].mean(axis=1))


def ring_per_object(values: Arrays, ring: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(object,) local Chamfer distance in a ring (0 the innermost), mean over the sites with points in it; and these sites' number.

    Where the number is 0 there is no value, and the distance is 0.
    """
    count = values["local_points"][..., ring] > 0  # (object, grasp, sensor)
    sites = count.sum(axis=(1, 2))
    total = np.where(count, values["local_chamfer"][..., ring], 0).sum(axis=(1, 2))
    return total / np.maximum(sites, 1), sites


def rings(models: Models, seed: int) -> Arrays:
    """Table 2."""
    ring = np.arange(1, 1 + next(iter(models.values()))["local_chamfer"].shape[-1])
    shape = (len(models), len(ring))
    made: Arrays = {name: np.zeros(shape) for name in ("local_chamfer", "low", "high")}
    made |= {name: np.zeros(shape, np.int32) for name in ("objects", "sites")}
    for row, (configuration, values) in enumerate(models.items()):
        for column in range(len(ring)):
            means, sites = ring_per_object(values, column)
            made["sites"][row, column], made["objects"][row, column] = sites.sum(), np.count_nonzero(sites)
            if sites.any():
                interval = mean_interval(means[sites > 0], numpy_rng(seed, "table_2", configuration, column))
                _fill(made, (row, column), "local_chamfer", interval)
    return {"configuration": names([*models]), "ring": ring, **made}


def grasps(models: Models, seed: int) -> Arrays:
    """Table 3, of models that take touch."""
    given = next(iter(models.values()))["grasps_given"]
    made: Arrays = {name: np.zeros((len(models), len(given))) for name in ("chamfer", "low", "high")}
    for row, (configuration, values) in enumerate(models.items()):
        for column, number in enumerate(given):
            interval = mean_interval(per_object(values, int(number)), numpy_rng(seed, "table_3", configuration, int(number)))
            _fill(made, (row, column), "chamfer", interval)
    return {"configuration": names([*models]), "grasps_given": given, **made}


def modalities(models: Models, objects: Arrays, tau: NDArray[np.float64], seed: int) -> Arrays:
    """Every model with one grasp, by class and overall; `objects` is the group of that name."""
    category = [*sorted(set(objects["category"])), ALL]
    members = [np.ones(len(objects["category"]), bool) if name == ALL else objects["category"] == name for name in category]
    shape = (len(models), len(category))
    made: Arrays = {name: np.zeros(shape) for name in ("chamfer", "low", "high")} | {"f1": np.zeros((*shape, len(tau)))}
    for row, (configuration, values) in enumerate(models.items()):
        chamfer, f1 = per_object(values, 1), values["f1"][:, :, 0].mean(axis=1)
        for column, (name, member) in enumerate(zip(category, members, strict=True)):
            _fill(made, (row, column), "chamfer", mean_interval(chamfer[member], numpy_rng(seed, "modalities", configuration, name)))
            made["f1"][row, column] = f1[member].mean(axis=0)
    return {
        "configuration": names([*models]),
        "category": names(category),
        "objects": np.array([member.sum() for member in members]),
        "floor": np.array([objects["floor"][member].mean() for member in members]),
        "tau": tau,
        **made,
    }


def _fill(made: Arrays, at: tuple[int, int], name: str, interval: Interval) -> None:
    made[name][at], made["low"][at], made["high"][at] = interval.mean, interval.low, interval.high


def charts(residual: np.ndarray, iterations: np.ndarray, stop_rule: np.ndarray) -> Arrays:
    """Touch-chart residuals by stop rule, from the arrays of the artifact `charts`."""
    chosen = {name: stop_rule == code for code, name in enumerate(STOP_RULES) if name != "no_touch" and (stop_rule == code).any()}
    chosen[ALL] = is_surface(stop_rule)
    return {
        "stop_rule": names([*chosen]),
        "charts": np.array([mask.sum() for mask in chosen.values()]),
        "residual_mean": np.array([_mean(residual[mask]) for mask in chosen.values()]),
        "residual_worst": np.array([float(residual[mask].max(initial=0)) for mask in chosen.values()]),
        "iterations": np.array([_mean(iterations[mask]) for mask in chosen.values()]),
    }


def _mean(values: np.ndarray) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else 0.0


def training(facts: Mapping[str, Mapping[str, Any]]) -> Arrays:
    """What each model's training came to, from the facts of its record; seconds and hardware stay there, for no digest holds them."""
    rows = list(facts.values())
    return {
        "configuration": names([*facts]),
        "parameters": np.array([row["parameters"] for row in rows]),
        "epochs": np.array([row["epochs"] for row in rows]),
        "best_epoch": np.array([row["best_epoch"] + 1 for row in rows]),
        "best_loss": np.array([row["best"]["loss"] for row in rows], float),
    }
