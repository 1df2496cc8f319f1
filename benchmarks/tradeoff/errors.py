"""What a variant's output is worth: of every stage a first figure, its error, and others beside it.

Each function takes the variant as made and the data directory of its reference. Its figures are named with their unit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage.metrics import structural_similarity
from skimage.transform import resize

from benchmarks.stored_grasps import examine
from benchmarks.tradeoff.work import Made, load_json
from pipeline.kernels.learning.metrics import TABLE_3_FACTOR
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.learning.split import load_split
from pipeline.learning.touch_model import load_touch_model
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from schemas.base import Artifact
from schemas.charts import CHARTS, FITTED, STOP_RULES
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.train_unet.learner import touches_of

Figures = dict[str, float]

UNREACHED = 4.0
"""Times the median distance to the nearest point: of random points on a surface 1 in 70,000 is farther; what is, was left out."""
SOUND = 1e-3
"""m that a rigid part may stand inside the object."""
POINTS = 20_000
"""On the hand, and on the object, that look for penetration: about 3 mm apart."""


def _pairs(made: Made, reference: Path, artifact: Artifact, *arrays: str) -> Iterator[tuple[list[np.ndarray], list[np.ndarray]]]:
    """Some arrays of each object, of the variant and of its reference."""
    ours, theirs = (Collection(Layout(data), artifact) for data in (made.data, reference))
    for object_id in ours:
        yield [ours.view(object_id)[name] for name in arrays], [theirs.view(object_id)[name] for name in arrays]


def surfaces(made: Made, reference: Path) -> Figures:
    """How far the reference's points are from the nearest of the variant's."""
    squares, unreached = [], []
    for (points,), (dense,) in _pairs(made, reference, SURFACES, "points"):
        distance = cKDTree(points).query(dense)[0]
        squares.append(np.mean(distance**2))
        unreached.append(np.mean(distance > UNREACHED * np.median(distance)))
    return {"coverage RMS, mm": 1e3 * float(np.sqrt(np.mean(squares))), "surface left out, %": 100 * float(np.mean(unreached))}


def grasps(made: Made, reference: Path) -> Figures:
    """How many of the sensors of all kept grasps do not touch, or not soundly, measured anew."""
    collection = Collection(Layout(made.data), GRASPS)
    seen = examine(made.data, POINTS)
    wanted = sum(collection.view(name)["touch_success"].size for name in collection)
    sound = sum(int((one.touched & ~one.changed).sum()) for one in seen if one.depth <= SOUND)
    attempts = np.mean([collection.view(name)["attempt_success"].mean() for name in collection])
    return {
        "touches missing or unsound, %": 100 * (1 - sound / wanted),
        "missing in all attempts, %": 100 * (1 - float(attempts)),
        "changed by 500 steps, %": 100 * float(np.mean([one.changed for one in seen])),
        "deepest, mm": 1e3 * max(one.depth for one in seen),
    }


def vision(made: Made, reference: Path) -> Figures:
    """How the images, enlarged to the reference's size, differ from it."""
    squares, likeness, silhouette = [], [], []
    for (image, labels), (truth, true_labels) in _pairs(made, reference, VISION, "unoccluded", "segmentation"):
        size = truth.shape[:2]
        ours, theirs = resize(image / 255.0, (*size, 3), order=1), truth / 255.0
        squares.append(np.mean((ours - theirs) ** 2))
        likeness.append(structural_similarity(ours, theirs, channel_axis=2, data_range=1.0))
        mask, true_mask = resize(labels[0] == 1, size, order=0), true_labels[0] == 1
        silhouette.append((mask != true_mask).sum() / true_mask.sum())
    return {
        "difference RMS, levels of 255": 255 * float(np.sqrt(np.mean(squares))),
        "silhouette wrong, % of it": 100 * float(np.mean(silhouette)),
        "1 - structural similarity": 1 - float(np.mean(likeness)),
    }


def touch(made: Made, reference: Path) -> Figures:
    """How far depths in the gel and beyond it are off, and how many readings show it."""
    sensor = Sensor.model_validate(Collection(Layout(reference), TOUCH).shards[0].attributes["sensor"])
    near: list[NDArray[np.float64]] = []
    far: list[NDArray[np.float64]] = []
    wrong, lost = [], 0
    for (depth, reading), (truth, true_reading) in _pairs(made, reference, TOUCH, "depth", "reading"):
        both = np.isfinite(depth) & np.isfinite(truth)
        lost += int((np.isfinite(depth) != np.isfinite(truth)).sum())
        error = np.abs(depth[both].astype(np.float64) - truth[both])
        near.append(error[truth[both] < sensor.w])
        far.append(error[truth[both] >= sensor.w])
        wrong.append(np.mean((reading != true_reading).any(axis=-1)))
    inside, beyond = 1e6 * np.concatenate(near), 1e6 * np.concatenate(far)
    return {
        "depth in the gel, 99.9 % within, um": float(np.percentile(inside, 99.9)),
        "worst in the gel, um": float(inside.max()),
        "99.9 % beyond it, um": float(np.percentile(beyond, 99.9)),
        "hits lost or invented": float(lost),
        "readings changed, % of pixels": 100 * float(np.mean(wrong)),
    }


def unet(made: Made, reference: Path) -> Figures:
    """The predicted depths of test objects that no training saw, against the true ones, where the sensors touched."""
    touches = touches_of(load_split(made.data, ["reading", "depth", "untouched", "touch_success"], "test"))
    model = load_touch_model(made.data / "models/unet", "cpu")
    index = tuple(touches.where.T)
    readings, depth = touches.split.arrays["reading"][index], touches.split.arrays["depth"][index]
    contact = depth < touches.sensor.w
    mask = model.mask(readings)
    predicted = model.depth(readings)
    distance = []
    x, y = pixel_centres(touches.sensor)
    for ours, seen, theirs, felt in zip(predicted, mask, depth, contact, strict=True):
        clouds = [np.stack([x[np.nonzero(at)[1]], y[np.nonzero(at)[0]], map_[at]], axis=1) for map_, at in ((ours, seen), (theirs, felt))]
        if all(map(len, clouds)):
            there, back = cKDTree(clouds[1]).query(clouds[0])[0], cKDTree(clouds[0]).query(clouds[1])[0]
            distance.append(np.sqrt((np.mean(there**2) + np.mean(back**2)) / 2))
    return {
        "depth RMS, um": 1e6 * float(np.sqrt(np.mean((predicted - depth)[contact].astype(np.float64) ** 2))),
        "clouds apart, RMS, um": 1e6 * float(np.mean(distance)),
    }


def charts(made: Made, reference: Path) -> Figures:
    """How far the touched points are from the chart fitted to them."""
    found, capped = [], []
    for (residual, rule), _ in _pairs(made, made.data, CHARTS, "residual", "stop_rule"):
        fitted = np.isin(rule, FITTED)
        found.append(residual[fitted].astype(np.float64))
        capped.append(rule[fitted] == STOP_RULES.index("cap"))
    um = 1e6 * np.concatenate(found)
    return {
        "cloud to chart, mean RMS, um": float(um.mean()),
        "worst, um": float(um.max()),
        "stopped by the cap, %": 100 * float(np.concatenate(capped).mean()),
    }


def gcn(made: Made, reference: Path) -> Figures:
    """The evaluation of the network on test objects: Chamfer distances over grasps, and one grasp alone."""
    tables = load_json(made.data / "evaluation/metrics.json")["tables"]
    by_grasps = np.array(tables["table_3"]["chamfer"][0])
    ends = [np.array(tables["table_3"][name][0]).mean() for name in ("low", "high")]
    return {
        "Chamfer x 9000": TABLE_3_FACTOR * float(by_grasps.mean()),
        "with one grasp": TABLE_3_FACTOR * float(by_grasps[0]),
        "95 % from": TABLE_3_FACTOR * float(ends[0]),
        "to": TABLE_3_FACTOR * float(ends[1]),
    }


def evaluation(made: Made, reference: Path) -> Figures:
    """How far the Chamfer distances that are reported are from those with most points."""
    ours, theirs = (
        np.array(load_json(data / "evaluation/metrics.json")["tables"]["table_3"]["chamfer"][0]) for data in (made.data, reference)
    )
    return {"reported Chamfer off, %": 100 * float(np.abs(ours / theirs - 1).mean())}


ERRORS: dict[str, Callable[[Made, Path], Figures]] = {
    "sample-surfaces": surfaces,
    "simulate-grasps": grasps,
    "render-vision": vision,
    "simulate-touch": touch,
    "train-unet": unet,
    "fit-charts": charts,
    "train-gcn": gcn,
    "evaluate": evaluation,
}
