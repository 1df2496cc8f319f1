"""What a network has to beat: a training object that is looked up, in place of a reconstruction."""

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
"""Per object by which one is looked up; what is found is measured on all of them."""
LOOKED_UP = "training object, "
"""How baselines are called begins with it."""

Silhouettes = Callable[[str], NDArray[np.bool_]]
"""Reads the silhouettes of an object, (view, pixel)."""


def retrieved(
    objects: TestObjects,
    known: ObjectRows,
    most: int,
    figures: Callable[[CloudDistances, int], Mapping[str, float]],
    *,
    silhouettes: Silhouettes | None = None,
    touched: Sequence[NDArray[np.float64]] | None = None,
) -> dict[str, Figures]:
    """Look a training object up for each test object, and measure it as a reconstruction is.

    Parameters
    ----------
    objects, known
        The test objects, and the training objects.
    most
        Training objects among which is looked, spread evenly.
    figures
        Measures distances between points, of the test object with that number.
    silhouettes
        Where the networks are shown images.
    touched
        (N, 3) points that were touched of each test object, where there are touches.

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
    names = [known.object_ids[at] for at in np.linspace(0, len(known) - 1, min(len(known), most)).astype(int)]
    clouds = [known.read("points", name).astype(np.float64) for name in names]
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
    views, ids = max(found[0].size for found in chosen.values()), objects.rows.object_ids
    return {LOOKED_UP + how: Figures(ids, _measured(objects, clouds, found, views, figures)) for how, found in chosen.items()}


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
        found = {at: figures(cloud_distances(clouds[at][: objects.count], objects.points(row)), row) for at in set(places)}
        rows += [Figure(object_id, view, 1, metric, value) for view, at in enumerate(places) for metric, value in found[at].items()]
    return rows
