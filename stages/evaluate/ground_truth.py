"""The objects of the test split, against which reconstructions are measured."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StageError, StoreError
from pipeline.kernels.metrics.cloud_distances import sampled_area, sampling_floor
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import Arrays

SPLIT = "test"


def training_objects(data: Location, arrays: Iterable[str]) -> ObjectRows | None:
    """Open the training objects, from which baselines retrieve; None if there are none, or all of them failed."""
    try:
        return ObjectRows(data, list(arrays), "train")
    except StoreError:
        return None


class TestObjects:
    """Hold the objects of the test split that have every array which a model needs: the same for all models.

    `count` is the number of points of S^obj per object: as many as are drawn from a reconstruction. A `StageError` says
    that the dataset has fewer.
    """

    def __init__(self, data: Location, arrays: Iterable[str], count: int, stage: str) -> None:
        self.rows, self.count = ObjectRows(data, list(arrays), SPLIT), count
        self.surfaces = DataDirectory(data).collection(SURFACES)
        if (available := self.rows.size("points", "point")) < count:
            raise StageError(f"{stage}.points is {count}, the dataset has {available} points per object; lower it, or sample more surface")

    def __len__(self) -> int:
        return len(self.rows)

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
        """Estimate the area of an object's surface, m², from distances between points: two sides of thin parts count once."""
        return sampled_area(self.points(row))

    def diagonal(self, row: int) -> float:
        """Compute the diagonal of an object's bounding box, m."""
        return self.rows.diagonal(self.rows.object_ids[row])

    def table(self) -> Arrays:
        """Make the group `objects` of the schema."""
        areas = [self.area(row) for row in range(len(self))]
        return {
            "object_id": np.array(self.rows.object_ids),
            "category": np.array(self.rows.categories),
            "diagonal": np.array([self.diagonal(row) for row in range(len(self))]),
            "area": np.array(areas),
            "floor": np.array([sampling_floor(area, self.count) for area in areas]),
        }
