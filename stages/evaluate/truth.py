"""What is evaluated on, and against what: the objects of the test split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StageError
from pipeline.kernels.touch.sensor import Sensor
from pipeline.models.observation import Observation, stored_observation
from pipeline.models.reconstruction import Reconstructor
from stages.evaluate.cases import Case
from stages.evaluate.settings import EvaluationSettings

SPLIT = "test"


@dataclass(frozen=True)
class Truth:
    """The objects of a split, and what their reconstructions are measured against.

    Attributes
    ----------
    rows
        Gives images, and touch charts of the models that feel.
    count
        Points of S^obj per object: as many as are drawn from a reconstruction.
    poses, touched
        (object, grasp, sensor, 4, 4) and (object, grasp, sensor) bool: the touch sites.
    width
        Of the sensor, m.
    """

    rows: ObjectRows
    count: int
    poses: NDArray[np.float64]
    touched: NDArray[np.bool_]
    width: float

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def grasps(self) -> int:
        """Grasps of every object."""
        return int(self.touched.shape[1])

    def points(self, row: int) -> NDArray[np.float64]:
        """(count, 3) points of S^obj of an object, world frame, m: drawn independently, hence the first are a fair sample."""
        return self.rows.read("points", self.rows.object_ids[row])[: self.count].astype(np.float64)

    def charts(self, name: str) -> np.ndarray:
        """An array of the touch charts of all objects: (object, …)."""
        return np.stack([self.rows.read(name, object_id) for object_id in self.rows.object_ids])

    def view(self, model: Reconstructor, row: int, case: Case) -> Observation:
        """What a model is shown of an object."""
        return stored_observation(self.rows, self.rows.object_ids[row], case.grasps or (case.first,), model.config)


def load_truth(data: Path, models: Sequence[Reconstructor], settings: EvaluationSettings) -> Truth:
    """Read the test split, and of images and charts only those that a model is shown.

    The same objects for every model: one that failed in what one of them needs is left out for all.
    """
    rows = ObjectRows(data, arrays_of(models), SPLIT)
    available = rows.size("points", "point")
    if available < settings.points:
        raise StageError(
            f"evaluate.points is {settings.points}, the dataset has {available} points per object; lower it, or sample more surface"
        )
    poses, touched = (np.stack([rows.read(name, object_id) for object_id in rows.object_ids]) for name in ("sensor_pose", "touch_success"))
    return Truth(rows, settings.points, poses, touched, Sensor.model_validate(rows.attributes("touch")["sensor"]).width)


def arrays_of(models: Sequence[Reconstructor]) -> list[str]:
    """The arrays that these models' evaluation reads; of `touch` a small one, for the sensor's description in the attributes."""
    images = sorted({model.image for model in models if model.image is not None})
    charts = ["vertices", "residual", "iterations", "stop_rule"] if any(model.touch for model in models) else []
    return ["points", "sensor_pose", "touch_success", "untouched", *images, *charts]
