"""What a network has to beat: a training object that is looked up, in place of a reconstruction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StoreError
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.metrics.retrieval import chamfer_matrix, mean_squared, silhouette_overlap
from pipeline.kernels.touch.contact import local_points
from pipeline.kernels.vision.labels import Label
from stages.evaluate.ground_truth import Truth

POINTS = 1000
"""Per object by which one is looked up; what is found is measured on all of them."""

Clouds = list[NDArray[np.float64]]


def retrieved(truth: Truth, job: DatasetJob) -> dict[str, NDArray[np.float64]]:
    """Look a training object up for each test object, and measure it as a reconstruction is.

    Returns
    -------
    The (object,) Chamfer distances, m², by how the training object is chosen:

    typical
        The one with the least mean distance to the others, whatever the test object.
    by silhouette
        The one whose silhouette has most in common with the unoccluded image's (intersection over union); where a model is shown one.
    by touch
        The one that the touched points of the first grasp are nearest to.
    by truth
        The nearest one: no retrieval is better.
    """
    try:
        known = ObjectRows(job.data, ["points"], "train")
    except StoreError:  # no training object came through
        return {}
    names = [known.object_ids[at] for at in np.linspace(0, len(known) - 1, min(len(known), job.settings.looked_up)).astype(int)]
    clouds = [known.read("points", name).astype(np.float64) for name in names]
    few, asked = [cloud[:POINTS] for cloud in clouds], [truth.points(row)[:POINTS] for row in range(len(truth))]
    trees = [cKDTree(cloud) for cloud in few]
    chosen = {
        "typical": np.full(len(truth), np.argmin(chamfer_matrix(few, few).mean(axis=0))),
        **_by_silhouette(truth, job, names),
        "by touch": np.array([np.argmin([mean_squared(tree, touched) for tree in trees]) for touched in _touched(truth)]),
        "by truth": chamfer_matrix(asked, few).argmin(axis=1),
    }
    return {
        how: np.array([cloud_distances(clouds[at][: truth.count], truth.points(row)).chamfer for row, at in enumerate(found)])
        for how, found in chosen.items()
    }


def _touched(truth: Truth) -> Clouds:
    """The points that the sensors touched in the first grasp of each object, (N, 3); the sensors' places where none touched."""
    sensor, found = truth.rows.sensor(), []
    for row, object_id in enumerate(truth.rows.object_ids):
        depth, poses = truth.rows.read("depth", object_id, 0), truth.poses[row, 0]
        clouds = [local_points(depth[site], poses[site], sensor) for site in np.flatnonzero(truth.touched[row, 0])]
        points = [cloud[:count] for cloud, count in clouds] or [poses[:, :3, 3]]
        found.append(np.concatenate(points).astype(np.float64))
    return found


def _by_silhouette(truth: Truth, job: DatasetJob, names: list[str]) -> dict[str, NDArray[np.intp]]:
    if not truth.seen:
        return {}
    images = ObjectRows(job.data, ["segmentation"], None)
    masks, asked = (
        np.array([(images.read("segmentation", name)[0] == Label.OBJECT).ravel() for name in some])
        for some in (names, truth.rows.object_ids)
    )
    return {"by silhouette": np.argmax(silhouette_overlap(asked, masks), axis=1)}
