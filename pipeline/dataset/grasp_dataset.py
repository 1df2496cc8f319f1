"""The grasps of a dataset for PyTorch."""

from collections.abc import Sequence
from typing import Any

import torch
from torch.utils.data import Dataset, default_collate

from pipeline.dataset.grasps import grasp_counts
from pipeline.dataset.object_rows import ObjectRows
from pipeline.store.storage import Location

Item = dict[str, Any]


class GraspDataset(Dataset[Item]):
    """Grasps of a split, each as a dict of tensors and the object's name; grasps that `read-grasps` repeated are skipped.

    Arrays with a grasp dimension give that grasp's part. Arrays of the object, also those of its presses or viewpoints,
    come whole and are read once per object. Constants (`untouched`) come as they are. Shapes, units and frames are the
    schemas'. `local_points` and `local_count` are computed from depth and pose where they are not stored: the same to
    the bit. Parameters and errors are those of `ObjectRows`.

    >>> train = GraspDataset("data/toy/draft", ["tactile_image", "sensor_pose", "points"], split="train")  # doctest: +SKIP
    >>> train[0]["tactile_image"].shape  # doctest: +SKIP
    torch.Size([4, 100, 100, 3])
    """

    def __init__(self, data: str | Location, arrays: Sequence[str], split: str | None = "train") -> None:
        self.rows = ObjectRows(data, [*arrays, "joint_angles"], split)  # whose shape gives the number of grasps
        self.arrays = tuple(arrays)
        self.failed = self.rows.failed
        self._of_grasps = {name for name in arrays if self.rows.dims(name)[1:2] == ("grasp",)}
        counts = grasp_counts(self.rows.collections["grasps"], self.rows.object_ids)
        self.items = [(object_id, grasp) for object_id, count in counts.items() for grasp in range(count)]

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: int) -> Item:
        object_id, grasp = self.items[index]
        numbers = {name: grasp if name in self._of_grasps else None for name in self.arrays}
        arrays = {name: self.rows.read(name, object_id, number) for name, number in numbers.items()}
        items = {name: str(value) if value.dtype.kind in "OUT" else torch.from_numpy(value.copy()) for name, value in arrays.items()}
        return {"object_id": object_id, "grasp": grasp, **items}

    @staticmethod
    def collate(items: Sequence[Item]) -> Item:
        """Make a batch, for `DataLoader(…, collate_fn=…)`: stacked arrays, but a list of those whose size differs per object."""
        columns = {name: [item[name] for item in items] for name in items[0]}
        return {name: column if "/" in name else default_collate(column) for name, column in columns.items()}
