"""The objects of the test split, and what their reconstructions are measured against."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StageError
from pipeline.kernels.metrics.cloud_distances import sampled_area
from pipeline.models.observation import Observation, stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.store.storage import Place
from stages.evaluate.reconstruction_cases import Case
from stages.evaluate.settings import EvaluationSettings

SPLIT = "test"


class Truth:
    """Hold the objects of the test split, the same for every model: one that failed in what one of them needs is left out for all.

    Of images and charts only those are read that a model is shown.

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
    seen
        Whether a model is shown an image.

    Raises
    ------
    StageError
        The dataset has fewer points per object.
    StoreError
        As `ObjectRows`.
    """

    def __init__(self, data: Place, models: Sequence[Reconstructor], settings: EvaluationSettings) -> None:
        self.rows = ObjectRows(data, arrays_of(models), SPLIT)
        self.count = settings.points
        if (available := self.rows.size("points", "point")) < self.count:
            raise StageError(
                f"evaluate.points is {self.count}, the dataset has {available} points per object; lower it, or sample more surface"
            )
        self.poses, self.touched = self.stack("sensor_pose"), self.stack("touch_success")
        self.width = self.rows.sensor().width
        self.seen = any(model.image for model in models)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def grasps(self) -> int:
        """Number of grasps per object."""
        return int(self.touched.shape[1])

    def stack(self, array: str) -> np.ndarray:
        """Read an array of all objects: (object, …)."""
        return np.stack([self.rows.read(array, object_id) for object_id in self.rows.object_ids])

    def points(self, row: int) -> NDArray[np.float64]:
        """Read (count, 3) points of S^obj of an object, world frame, m: drawn independently, hence the first are a fair sample."""
        return self.rows.read("points", self.rows.object_ids[row])[: self.count].astype(np.float64)

    def normals(self, row: int) -> NDArray[np.float64]:
        """Read the (count, 3) outward unit normals at `points`."""
        return self.rows.read("normals", self.rows.object_ids[row])[: self.count].astype(np.float64)

    def area(self, row: int) -> float:
        """Compute the area of an object's surface, m², as distances between points show it: two sides of thin parts count once."""
        return sampled_area(self.points(row))

    def area_of_all_sides(self, row: int) -> float:
        """Compute the area of an object's surface, m²."""
        return sampled_area(self.points(row), self.normals(row))

    def view(self, model: Reconstructor, row: int, case: Case) -> Observation:
        """Read what a model is shown of an object."""
        return stored_observation(self.rows, self.rows.object_ids[row], case.grasps or (case.first,), model.config)


def arrays_of(models: Sequence[Reconstructor]) -> list[str]:
    """List the arrays that these models' evaluation reads; `untouched` for the sensor's description in the attributes."""
    images = sorted({model.image for model in models if model.image is not None})
    charts = ["vertices", "residual", "iterations", "stop_rule"] if any(model.touch for model in models) else []
    return ["points", "normals", "depth", "sensor_pose", "touch_success", "untouched", *images, *charts]
