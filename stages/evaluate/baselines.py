"""Baselines: a training object retrieved in place of a reconstruction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances
from pipeline.kernels.metrics.retrieval import chamfer_matrix, mean_squared_distance, silhouette_overlap
from stages.evaluate.evaluation_files import Figure, Figures
from stages.evaluate.ground_truth import TestObjects

POINTS = 1000
"""Points per object by which it is retrieved; the retrieved object is measured on all of its points."""
LOOKED_UP = "training object, "
"""Begins the name of each baseline."""
LABELS = {
    "typical": "typical training object",
    "by silhouette": "training object of the most similar silhouette",
    "by touch": "training object nearest to the touches",
    "by truth": "nearest training object",
}
"""How tables call them, by how they are chosen."""

Silhouettes = Callable[[str], NDArray[np.bool_]]
"""Reads the silhouettes of an object, (view, pixel)."""


def label(name: str) -> str:
    """Label a network, or a baseline, for a table."""
    return f"baseline: {LABELS[name.removeprefix(LOOKED_UP)]}" if name.startswith(LOOKED_UP) else name


def retrieve(
    objects: TestObjects,
    training: ObjectRows,
    most: int,
    figures: Callable[[CloudDistances, int], Mapping[str, float]],
    *,
    silhouettes: Silhouettes | None = None,
    touched: Sequence[NDArray[np.float64]] | None = None,
) -> dict[str, Figures]:
    """Retrieve a training object for each test object, and measure it as a reconstruction.

    Parameters
    ----------
    objects, training
        The test objects, and the training objects.
    most
        Number of training objects to choose from, spread evenly.
    figures
        Makes figures of the distances between points, given the number of the test object.
    silhouettes
        For networks that take images.
    touched
        (N, 3) touched points of each test object, m, if there are touches.

    Returns
    -------
    The figures by how the training object is chosen:

    typical
        The one with the least mean distance to the others, whatever the test object.
    by silhouette
        The one of which a silhouette has most in common with the image's (intersection over union).
    by touch
        The one that the touched points of the first grasp are nearest to.
    by truth
        The nearest one: no retrieval is better.
    """
    names = [training.object_ids[at] for at in np.linspace(0, len(training) - 1, min(len(training), most)).astype(int)]
    clouds = [training.read("points", name).astype(np.float64) for name in names]
    few, asked = [cloud[:POINTS] for cloud in clouds], [objects.points(row)[:POINTS] for row in range(len(objects))]
    chosen: dict[str, NDArray[np.intp]] = {"typical": np.full(len(objects), np.argmin(chamfer_matrix(few, few).mean(axis=0)))}
    if silhouettes is not None:
        masks = [silhouettes(name) for name in names]
        alike = [silhouette_overlap(silhouettes(name), np.concatenate(masks)).argmax(axis=1) for name in objects.rows.object_ids]
        chosen["by silhouette"] = np.array(alike) // len(masks[0])  # (object, view)
    if touched is not None:
        trees = [cKDTree(cloud) for cloud in few]
        chosen["by touch"] = np.array([np.argmin([mean_squared_distance(tree, points) for tree in trees]) for points in touched])
    chosen["by truth"] = chamfer_matrix(asked, few).argmin(axis=1)
    views, ids = max(matches[0].size for matches in chosen.values()), objects.rows.object_ids
    return {LOOKED_UP + how: Figures(ids, _measured(objects, clouds, matches, views, figures)) for how, matches in chosen.items()}


def _measured(
    objects: TestObjects,
    clouds: Sequence[NDArray[np.float64]],
    chosen: NDArray[np.intp],
    views: int,
    figures: Callable[[CloudDistances, int], Mapping[str, float]],
) -> list[Figure]:
    rows = []
    for row, object_id in enumerate(objects.rows.object_ids):
        places = np.broadcast_to(chosen[row], views).tolist()
        measured = {at: figures(cloud_distances(clouds[at][: objects.count], objects.points(row)), row) for at in set(places)}
        rows += [Figure(object_id, view, 1, metric, value) for view, at in enumerate(places) for metric, value in measured[at].items()]
    return rows
