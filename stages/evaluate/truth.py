"""What is evaluated on, and against what: the objects of the test split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.split import Split, load_split
from pipeline.errors import StageError
from pipeline.kernels.touch.sensor import Sensor
from pipeline.models.reconstruct import Reconstructor, View
from stages.evaluate.cases import Case
from stages.evaluate.settings import EvaluationSettings

SPLIT = "test"


@dataclass(frozen=True)
class Truth:
    """The objects of a split, and what their reconstructions are measured against.

    Attributes
    ----------
    points
        (object, point, 3) of S^obj, world frame, m: as many as are drawn from a reconstruction.
    poses, touched
        (object, grasp, sensor, 4, 4) and (object, grasp, sensor) bool: the touch sites.
    width
        Of the sensor, m.
    """

    split: Split
    points: NDArray[np.float64]
    poses: NDArray[np.float64]
    touched: NDArray[np.bool_]
    width: float

    def __len__(self) -> int:
        return len(self.split)

    @property
    def grasps(self) -> int:
        """Grasps of every object."""
        return int(self.touched.shape[1])

    def view(self, model: Reconstructor, row: int, case: Case) -> View:
        """What a model is shown of an object."""
        arrays, grasps = self.split.arrays, list(case.grasps)
        image = None if model.image is None else arrays[model.image][row]
        if image is not None and model.image == "occluded":
            image = image[case.first]
        if not model.touch:
            return View.unfelt(image)
        return View.felt(image, arrays["vertices"][row, grasps], arrays["stop_rule"][row, grasps])


def load_truth(data: Path, models: Sequence[Reconstructor], settings: EvaluationSettings) -> Truth:
    """Read the test split, and of images and charts only those that a model is shown.

    The same objects for every model: one that failed in what one of them needs is left out for all.
    """
    split = load_split(data, arrays_of(models), SPLIT)
    points = split.arrays["points"]
    if points.shape[1] < settings.points:
        raise StageError(
            f"evaluate.points is {settings.points}, the data set has {points.shape[1]} points an object; lower it, or sample more surface"
        )
    return Truth(
        split=split,
        points=points[:, : settings.points].astype(np.float64),  # drawn independently, hence the first are a fair sample
        poses=split.arrays["sensor_pose"],
        touched=split.arrays["touch_success"],
        width=Sensor.model_validate(split.attributes["touch"]["sensor"]).width,
    )


def arrays_of(models: Sequence[Reconstructor]) -> list[str]:
    """The arrays that these models' evaluation reads; of `touch` a small one, for the sensor's description in the attributes."""
    images = sorted({model.image for model in models if model.image is not None})
    charts = ["vertices", "residual", "iterations", "stop_rule"] if any(model.touch for model in models) else []
    return ["points", "sensor_pose", "touch_success", "untouched", *images, *charts]
