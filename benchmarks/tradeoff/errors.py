"""Measure the errors of variants: per stage a first figure, its error, and others beside it.

Each function takes the variant as made and the data directory of its reference. Figures are named with their unit; with them comes
the error of each object alone, whose spread bounds the error on another dataset.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import t as student
from skimage.metrics import structural_similarity
from skimage.transform import resize

from benchmarks.stored_grasps import examine
from benchmarks.tradeoff.runs import Made
from pipeline.dataset.object_rows import ObjectRows
from pipeline.dataset.touch_sensors import touch_sensor
from pipeline.kernels.metrics.bootstrap import mean_interval
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.models.touch_model import load_touch_model
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from schemas.charts import FITTED, STOP_RULES
from schemas.grasps import GRASPS
from schemas.touch import TOUCH
from stages.evaluate.evaluation_files import read_figures, read_root
from stages.train_unet.learner import load_touches

Figures = dict[str, float]

SURE = 0.95
"""Confidence of the bound: 19 of 20 other datasets keep to it."""
UNREACHED = 4.0
"""Multiple of the median distance to the nearest point beyond which surface counts as left out: 1 in 70,000 random points is farther."""
SOUND = 1e-3
"""m that a rigid part may be inside the object."""
POINTS = 20_000
"""On the hand, and on the object, that look for penetration: about 3 mm apart."""


@dataclass(frozen=True)
class Errors:
    """The errors of a variant.

    Attributes
    ----------
    figures
        By name with unit; the first is the error.
    each
        The error of every object alone.
    power
        Errors are taken together as this power: 2 where the error is the root of a mean square.
    touches
        Of how many it is a share, if it is one.
    """

    figures: Figures
    each: Sequence[float]
    power: int = 1
    touches: int = 0

    @property
    def error(self) -> float:
        """The first figure."""
        return next(iter(self.figures.values()))

    def bound(self, seeds: Sequence[float]) -> float:
        """Bound the error on another dataset of as many such objects, with confidence `SURE`.

        Student's t of how two such datasets differ, by their objects and, with errors of several `seeds`, by chance in training;
        degrees of freedom after Welch and Satterthwaite. Where no touch was missing, 3 of all may be (the rule of three, for
        touches that know nothing of each other).
        """
        parts = [_variance(np.power(self.each, self.power)) / len(self.each), _variance(np.power(seeds, self.power))]
        freedom = [len(self.each) - 1, max(len(seeds) - 1, 1)]
        above = 0.0
        if variance := 2 * sum(parts):
            above = float(
                student.ppf(SURE, variance**2 / sum((2 * v) ** 2 / n for v, n in zip(parts, freedom, strict=True))) * np.sqrt(variance)
            )
        bound = float((self.error**self.power + above) ** (1 / self.power))
        return min(100.0, max(bound, 300 / self.touches)) if self.touches else bound


def _variance(values: NDArray[np.float64]) -> float:
    return float(np.var(values, ddof=1)) if len(values) > 1 else 0.0


def _pairs(made: Made, reference: Path, *arrays: str) -> Iterator[tuple[list[np.ndarray], list[np.ndarray]]]:
    """Read arrays of each object that failed in neither, of the variant and of its reference."""
    ours, theirs = (ObjectRows(data, arrays, split=None) for data in (made.data, reference))
    for object_id in ours.object_ids:
        if object_id not in theirs.left_out:
            yield [ours.read(name, object_id) for name in arrays], [theirs.read(name, object_id) for name in arrays]


def surfaces(made: Made, reference: Path) -> Errors:
    """Measure how far the reference's points are from the nearest of the variant's."""
    squares, unreached = [], []
    for (points,), (dense,) in _pairs(made, reference, "points"):
        distance = cKDTree(points).query(dense)[0]
        squares.append(np.mean(distance**2))
        unreached.append(np.mean(distance > UNREACHED * np.median(distance)))
    figures = {"coverage RMS, mm": 1e3 * float(np.sqrt(np.mean(squares))), "surface left out, %": 100 * float(np.mean(unreached))}
    return Errors(figures, list(1e3 * np.sqrt(squares)), power=2)


def grasps(made: Made, reference: Path) -> Errors:
    """Measure how many sensors of all kept grasps do not touch, or not soundly."""
    collection = DataDirectory(made.data).collection(GRASPS)
    examined = examine(made.data, POINTS)
    each = []
    for object_id in collection:
        sound = sum(int((one.touched & ~one.changed).sum()) for one in examined.get(object_id, []) if one.depth <= SOUND)
        each.append(100 * (1 - sound / collection.view(object_id)["touch_success"].size))
    seen = [one for found in examined.values() for one in found]
    attempts = np.mean([collection.view(name)["attempt_success"].mean() for name in collection])
    figures = {
        "touches missing or unsound, %": float(np.mean(each)),
        "missing in all attempts, %": 100 * (1 - float(attempts)),
        "changed by 500 steps, %": 100 * float(np.mean([one.changed for one in seen])),
        "deepest, mm": 1e3 * max(one.depth for one in seen),
    }
    return Errors(figures, each, touches=sum(one.touched.size for one in seen))


def vision(made: Made, reference: Path) -> Errors:
    """Compare the images, enlarged to the reference's size, with it."""
    squares, likeness, silhouette = [], [], []
    for ((image,), labels), ((truth,), true_labels) in _pairs(made, reference, "unoccluded", "segmentation"):
        size = truth.shape[:2]
        ours, theirs = resize(image / 255.0, (*size, 3), order=1), truth / 255.0  # type: ignore[no-untyped-call]
        squares.append(np.mean((ours - theirs) ** 2))
        likeness.append(structural_similarity(ours, theirs, channel_axis=2, data_range=1.0))  # type: ignore[no-untyped-call]
        mask, true_mask = resize(labels[0, 0] == 1, size, order=0), true_labels[0, 0] == 1  # type: ignore[no-untyped-call]
        silhouette.append((mask != true_mask).sum() / true_mask.sum())
    figures = {
        "difference RMS, levels of 255": 255 * float(np.sqrt(np.mean(squares))),
        "silhouette wrong, % of it": 100 * float(np.mean(silhouette)),
        "1 - structural similarity": 1 - float(np.mean(likeness)),
    }
    return Errors(figures, list(255 * np.sqrt(squares)), power=2)


def touch(made: Made, reference: Path) -> Errors:
    """Measure how far depths in the gel and beyond it are off, and how many tactile images show it."""
    sensor = touch_sensor(DataDirectory(reference).collection(TOUCH).first.attributes)
    near: list[NDArray[np.float64]] = []
    far: list[NDArray[np.float64]] = []
    wrong, lost = [], 0
    for (depth, image), (truth, true_image) in _pairs(made, reference, "depth", "tactile_image"):
        both = np.isfinite(depth) & np.isfinite(truth)
        lost += int((np.isfinite(depth) != np.isfinite(truth)).sum())
        error = np.abs(depth[both].astype(np.float64) - truth[both])
        near.append(error[truth[both] < sensor.w])
        far.append(error[truth[both] >= sensor.w])
        wrong.append(np.mean((image != true_image).any(axis=-1)))
    inside, beyond = 1e6 * np.concatenate(near), 1e6 * np.concatenate(far)
    figures = {
        "depth in the gel, 99.9 % within, um": float(np.percentile(inside, 99.9)),
        "worst in the gel, um": float(inside.max()),
        "99.9 % beyond it, um": float(np.percentile(beyond, 99.9)),
        "hits lost or invented": float(lost),
        "tactile images changed, % of pixels": 100 * float(np.mean(wrong)),
    }
    return Errors(figures, [1e6 * float(np.percentile(error, 99.9)) for error in near if len(error)])


def unet(made: Made, reference: Path) -> Errors:
    """Compare the predicted depths of test objects with the true ones, where the sensors touched."""
    touches = load_touches(made.data, "test")
    model = load_touch_model(DataDirectory(made.data).whole_folder("models/unet"), "cpu")
    tactile_images, depth = (tensor.numpy() for tensor in touches.read(range(len(touches))))
    contact = depth < touches.sensor.w
    mask = model.mask(tactile_images)
    predicted = model.depth(tactile_images)
    distance = []
    x, y = pixel_centres(touches.sensor)
    for ours, seen, theirs, felt in zip(predicted, mask, depth, contact, strict=True):
        clouds = [np.stack([x[np.nonzero(at)[1]], y[np.nonzero(at)[0]], map_[at]], axis=1) for map_, at in ((ours, seen), (theirs, felt))]
        if all(map(len, clouds)):
            there, back = cKDTree(clouds[1]).query(clouds[0])[0], cKDTree(clouds[0]).query(clouds[1])[0]
            distance.append(np.sqrt((np.mean(there**2) + np.mean(back**2)) / 2))
    squares = np.where(contact, (predicted - depth).astype(np.float64), 0.0) ** 2
    of_objects = [touches.where[:, 0] == number for number in np.unique(touches.where[:, 0])]
    figures = {
        "depth RMS, um": 1e6 * float(np.sqrt(squares.sum() / contact.sum())),
        "clouds apart, RMS, um": 1e6 * float(np.mean(distance)),
    }
    return Errors(figures, [1e6 * float(np.sqrt(squares[own].sum() / contact[own].sum())) for own in of_objects], power=2)


def charts(made: Made, reference: Path) -> Errors:
    """Measure how far the touched points are from the chart fitted to them."""
    found, capped = [], []
    for (residual, rule), _ in _pairs(made, made.data, "residual", "stop_rule"):
        fitted = np.isin(rule, FITTED)
        found.append(residual[fitted].astype(np.float64))
        capped.append(rule[fitted] == STOP_RULES.index("cap"))
    um = 1e6 * np.concatenate(found)
    figures = {
        "cloud to chart, mean RMS, um": float(um.mean()),
        "worst, um": float(um.max()),
        "stopped by the cap, %": 100 * float(np.concatenate(capped).mean()),
    }
    return Errors(figures, [1e6 * float(one.mean()) for one in found if len(one)])


def gcn(made: Made, reference: Path) -> Errors:
    """Collect the network's Chamfer distances on test objects: over all numbers of grasps, and with one grasp."""
    table = table_3(made.data)
    means = TABLE_3_FACTOR * table.mean(axis=1)
    figures = {"Chamfer x 9000": float(means.mean()), "with one grasp": float(means[0])}
    if table.shape[1] > 1:  # of a single test object there is no interval
        found = [mean_interval(values, numpy_rng(0, "table_3", number)) for number, values in enumerate(table)]
        ends = {"95 % from": [interval.low for interval in found], "to": [interval.high for interval in found]}
        figures |= {name: TABLE_3_FACTOR * float(np.mean(values)) for name, values in ends.items()}
    return Errors(figures, list(TABLE_3_FACTOR * table.mean(axis=0)))


def evaluation(made: Made, reference: Path) -> Errors:
    """Compare the reported Chamfer distances with those of most points."""
    ours, theirs = (table_3(data).mean(axis=1) for data in (made.data, reference))  # (grasps given,)
    truth = table_3(reference).mean(axis=0)
    each = 100 * (table_3(made.data).mean(axis=0) - truth) / truth.mean()
    return Errors({"reported Chamfer off, %": 100 * float(np.abs(ours / theirs - 1).mean())}, list(each))


def table_3(data: Path) -> NDArray[np.float64]:
    """(grasps given, object) Chamfer distances of the first network that feels, mean over first grasps."""
    folder = DataDirectory(data).whole_folder("evaluation")
    felt = next(name for name, given in read_root(folder)["configurations"].items() if given["touch"])
    figures = read_figures(folder)[felt]
    return np.stack([figures.per_object("chamfer", number) for number in figures.grasps])


ERRORS: dict[str, Callable[[Made, Path], Errors]] = {
    "sample-surfaces": surfaces,
    "simulate-grasps": grasps,
    "render-vision": vision,
    "simulate-touch": touch,
    "train-unet": unet,
    "fit-charts": charts,
    "train-gcn": gcn,
    "evaluate": evaluation,
}
