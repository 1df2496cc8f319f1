"""Baselines: a training object retrieved in place of a reconstruction."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from pipeline.console import Meter
from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, POSITION
from pipeline.kernels.geometry.transforms import scaling_about, transform_points
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances
from pipeline.kernels.metrics.nearest_points import Cloud
from pipeline.kernels.metrics.retrieval import SearchedClouds, nearest_cloud, packed_masks, silhouette_overlap, typical_cloud
from stages.evaluate.evaluation_files import Figure, Figures
from stages.evaluate.measure import MeasuredObjects

POINTS = 1000  # points per object that the search compares; the retrieved object is measured on all of its points
BLOCK = 2000  # training objects whose points are in memory at a time, a tenth of a megabyte each
CANDIDATES = 200  # training objects, spread evenly, among which the typical one is chosen: the time grows with their square
BASELINE_PREFIX = "training object, "  # prefix of the name of each baseline
LABELS = {
    "typical": "typical training object",
    "by silhouette": "training object of the most similar silhouette",
    "by touch": "training object nearest to the touches",
    "by truth": "nearest training object",
}
"""Labels of baselines in tables, by method of choice."""

Silhouettes = Callable[[str], NDArray[np.bool_]]  # reads the silhouettes of an object, (view, pixel)
Points = Callable[[str], NDArray[np.float64]]  # reads points of a test object, (N, 3) m


def label(name: str) -> str:
    """Label a network, or a baseline, for a table."""
    return f"baseline: {LABELS[name.removeprefix(BASELINE_PREFIX)]}" if name.startswith(BASELINE_PREFIX) else name


def retrieved_by(image: object, touch: bool) -> str:
    """Name the baseline with the same inputs: by silhouette if an image is given, else by touch if touches are, else the typical object."""
    return BASELINE_PREFIX + ("by silhouette" if image else "by touch" if touch else "typical")


def retrieve(
    objects: MeasuredObjects,
    training: ObjectRows,
    figures: Callable[[CloudDistances, str], Mapping[str, float]],  # of the distances for a test object
    *,
    console: Console,
    silhouettes: Silhouettes | None = None,  # for networks that take images
    touched: Points | None = None,  # if there are touches
) -> dict[str, Figures]:  # by method of choice
    """Retrieve a training object for each test object, and measure it as a reconstruction.

    `typical` has the least mean distance to the others, of at most `CANDIDATES`, and is the same for every test
    object. `by silhouette` has the silhouette most similar to the image's (intersection over union). `by touch` is
    nearest to the touched points of the first grasp. `by truth` is nearest by the Chamfer distance of `POINTS` points:
    no retrieval is nearer by that distance.
    """
    ids, names = objects.object_ids, training.object_ids
    spread = np.linspace(0, len(names) - 1, min(len(names), CANDIDATES)).astype(int)
    queries: dict[str, Points] = {"by touch": touched} if touched else {}
    queries["by truth"] = lambda name: objects.points(name)[:POINTS]
    steps = (-(-len(names) // BLOCK) + 1) * len(ids)
    with Meter(console, "training objects in place of reconstructions", steps, "comparisons") as meter:
        typical = typical_cloud(SearchedClouds([_cloud(training, names[at]) for at in spread]))
        matches_by_method = {"typical": np.full((len(ids), 1), spread[typical])}
        if silhouettes is not None:
            matches_by_method["by silhouette"] = _most_similar(silhouettes, ids, names)
        matches_by_method |= _nearest(queries, objects, training, meter)
        views = max(matches.shape[1] for matches in matches_by_method.values())
        rows: dict[str, list[Figure]] = {method: [] for method in matches_by_method}
        for row, object_id in enumerate(ids):
            truth, figures_by_object = Cloud(objects.points(object_id)), dict[int, Mapping[str, float]]()
            for method, matches in matches_by_method.items():
                for view, at in enumerate(np.broadcast_to(matches[row], views).tolist()):
                    if at not in figures_by_object:
                        cloud = _cloud(training, names[at], objects.count, objects.diagonal(object_id))
                        figures_by_object[at] = figures(cloud_distances(cloud, truth), object_id)
                    rows[method] += [Figure(object_id, view, 1, metric, value) for metric, value in figures_by_object[at].items()]
            meter.advance()
        return {BASELINE_PREFIX + method: Figures(ids, of_method) for method, of_method in rows.items()}


def _cloud(training: ObjectRows, name: str, count: int = POINTS, size: float = DIAGONAL) -> Cloud:
    """Read points of an object, as if its diagonal were `size`, m; by default those that the search compares."""
    return Cloud(_scaled(training.read("points", name)[:count].astype(np.float64), training.diagonal(name), size))


def _scaled(points: NDArray[np.float64], size: float, to: float = DIAGONAL) -> NDArray[np.float64]:
    """Scale points (N, 3) of an object of a size, m, to another: networks, too, are told how large an object is."""
    return points if size == to else transform_points(scaling_about(POSITION, to / size), points)


def _most_similar(silhouettes: Silhouettes, ids: Sequence[str], names: Sequence[str]) -> NDArray[np.intp]:  # (object, view)
    """Choose the number of the training object, of `names`, with the most similar silhouette, for each view of the test objects."""
    ours, theirs = (np.stack([packed_masks(silhouettes(name)) for name in part]) for part in (ids, names))  # (object, view, word)
    every = theirs.reshape(-1, theirs.shape[-1])
    return np.array([[silhouette_overlap(mask, every).argmax() // theirs.shape[1] for mask in views] for views in ours])


def _nearest(
    queries: Mapping[str, Points],  # by method
    objects: MeasuredObjects,
    training: ObjectRows,
    meter: Meter,
) -> dict[str, NDArray[np.intp]]:  # (object, 1), by method
    """Choose the number of the training object with the nearest points for each test object."""
    nearest = {method: [(np.inf, 0)] * len(objects) for method in queries}
    for start in range(0, len(training), BLOCK):
        block = SearchedClouds([_cloud(training, name) for name in training.object_ids[start : start + BLOCK]])
        for row, name in enumerate(objects.object_ids):
            for method, read in queries.items():  # read for each block: touches of all objects would fill the memory
                query = Cloud(_scaled(read(name), objects.diagonal(name)))
                if match := nearest_cloud(query, block, both=method == "by truth", below=nearest[method][row][0]):
                    nearest[method][row] = match[0], start + match[1]
            meter.advance()
    return {method: np.array([[number] for _, number in matches]) for method, matches in nearest.items()}
