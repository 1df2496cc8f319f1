"""One model on the objects of a split: reconstruct each case once, and measure it against S^obj."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import islice

import numpy as np

from pipeline.errors import StageError
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances
from pipeline.kernels.metrics.touch_site_rings import ring_means, ring_of
from pipeline.models.reconstruction import Reconstruction, Reconstructor
from pipeline.rng import numpy_rng
from stages.evaluate.cases import Case, make_cases
from stages.evaluate.settings import EvaluationSettings
from stages.evaluate.store import Arrays
from stages.evaluate.truth import Truth

THRESHOLDS = (1.0, 2.0)
"""F1 is measured at tau and at twice tau (Table 4)."""


def measure(name: str, model: Reconstructor, truth: Truth, settings: EvaluationSettings, seed: int, tick: Callable[[], None]) -> Arrays:
    """The arrays of the groups `values` and `predictions` of the model called `name` (see the schema); `tick` after every object."""
    numbers, cases = cases_of(model, truth.grasps, settings)
    sites = (*truth.touched.shape, settings.rings)
    shape = (len(truth), truth.grasps, len(numbers))
    found: Arrays = {
        "chamfer": np.zeros(shape),
        **{name: np.zeros((*shape, len(THRESHOLDS))) for name in ("precision", "recall", "f1")},
        "local_chamfer": np.zeros(sites),
        "local_points": np.zeros(sites, np.int32),
        "grasps_given": np.array(numbers, np.int32),
        "first_grasp": np.array([case.first for case in cases], np.int32),
        "case_grasps": np.array([len(case.grasps) for case in cases], np.int32),
    }
    points_of = lru_cache(maxsize=1)(truth.points)  # an object's cases come one after the other
    for row, number, made in _reconstructed(model, truth, cases, settings.batch_size):
        case = cases[number]
        identity = ("evaluate", truth.rows.object_ids[row], name, case.first, len(case.grasps))
        apart = _distances(made, points_of(row), settings.points, numpy_rng(seed, *identity), " ".join(map(str, identity[1:])))
        _note(found, row, case, apart, settings)
        if numbers[case.given] == 1:
            for first in case.firsts:
                _note_rings(found, row, first, apart, truth, settings.rings)
        if "vertices" not in found:
            found |= _surface(made, (len(truth), len(cases)))
        found["vertices"][row, number] = made.vertices[: made.vision]
        if number == len(cases) - 1:
            tick()
    return found


def cases_of(model: Reconstructor, available: int, settings: EvaluationSettings) -> tuple[list[int], list[Case]]:
    """The numbers of grasps that a model is evaluated with, of `available` ones an object, and its reconstructions of each object."""
    numbers = [number for number in settings.grasps if number <= available] if model.touch else [1]
    return numbers, make_cases(available, numbers, touch=model.touch, occluded=model.image == "occluded")


def _reconstructed(model: Reconstructor, truth: Truth, cases: Sequence[Case], batch_size: int) -> Iterator[tuple[int, int, Reconstruction]]:
    """Every object's every case, reconstructed a batch at a time: rows, numbers of cases, and what came out."""
    work = ((row, number) for row in range(len(truth)) for number in range(len(cases)))
    while batch := list(islice(work, batch_size)):
        made = model.reconstruct([truth.view(model, row, cases[number]) for row, number in batch])
        yield from ((row, number, one) for (row, number), one in zip(batch, made, strict=True))


def _distances(made: Reconstruction, points: np.ndarray, count: int, rng: np.random.Generator, name: str) -> CloudDistances:
    """How far points drawn from a reconstruction and points of the truth are apart."""
    if not np.isfinite(made.vertices).all():
        raise StageError(f"the reconstruction of {name} holds NaN or infinity; was the model trained to the end?")
    return cloud_distances(sample_triangles(made.vertices[made.faces], count, rng)[0], points)


def _note(found: Arrays, row: int, case: Case, apart: CloudDistances, settings: EvaluationSettings) -> None:
    at = (row, list(case.firsts), case.given)
    found["chamfer"][at] = apart.chamfer
    for threshold, multiple in enumerate(THRESHOLDS):
        tau = multiple * settings.tau
        found["precision"][(*at, threshold)], found["recall"][(*at, threshold)] = apart.precision_recall(tau, settings.scale)
        found["f1"][(*at, threshold)] = apart.f1(tau, settings.scale)


def _note_rings(found: Arrays, row: int, grasp: int, apart: CloudDistances, truth: Truth, rings: int) -> None:
    for sensor in np.flatnonzero(truth.touched[row, grasp]):
        ring = ring_of(truth.points(row), truth.poses[row, grasp, sensor], truth.width, rings)
        at = (row, grasp, sensor)
        found["local_chamfer"][at], found["local_points"][at] = ring_means(apart.truth, ring, rings)


def _surface(made: Reconstruction, cases: tuple[int, int]) -> Arrays:
    """Room for the vision charts of every case, and how their vertices hang together."""
    return {
        "vertices": np.zeros((*cases, made.vision, 3), np.float32),
        "faces": made.faces[(made.faces < made.vision).all(axis=1)].astype(np.int32),
        "position": np.asarray(made.position, np.int32),
    }
