"""Training items: an object, how many of its grasps, and which."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from pipeline.dataset.split import Split, load_split
from pipeline.kernels.metrics.chamfer import Target
from pipeline.kernels.networks.configurations import NetworkConfig
from pipeline.models.reconstruct import View


class Items:
    """The objects of a split as a network is given them; only the arrays it looks at are read.

    Parameters
    ----------
    data, split
        A data directory, and a split of it.
    config
        Says which image is seen, and whether touch is felt.
    each
        Items an object, each beginning with another grasp.
    """

    def __init__(self, data: Path, split: str, config: NetworkConfig, each: int) -> None:
        self.split: Split = load_split(data, arrays_of(config), split)
        self.config, self.each = config, each
        self.targets = [Target(torch.from_numpy(points)) for points in self.split.arrays["points"]]

    def __len__(self) -> int:
        return len(self.split) * self.each

    @property
    def camera(self) -> np.ndarray | None:
        """(3, 4) projection matrix of the images, None without them."""
        return self.split.arrays.get("camera")

    @property
    def resolution(self) -> list[int] | None:
        """Rows and columns of the images."""
        return None if self.config.image is None else list(self.split.arrays[self.config.image].shape[-3:-1])

    def target(self, item: int) -> Target:
        """The object's points, (N, 3) float32, m, world."""
        return self.targets[item // self.each]

    def view(self, item: int, grasps: np.ndarray) -> View:
        """What the network is given: the charts of these grasps, and the image of the first."""
        row = item // self.each
        arrays = self.split.arrays
        image = None
        if self.config.image is not None:
            stored = arrays[self.config.image]
            image = stored[row, grasps[0] % stored.shape[1]] if self.config.image == "occluded" else stored[row]
        if not self.config.touch:
            return View.unfelt(image)
        return View.felt(image, arrays["vertices"][row, grasps], arrays["stop_rule"][row, grasps])

    def grasps_of(self, item: int, count: int, others: np.ndarray) -> np.ndarray:
        """The item's own grasp, then `count` - 1 of the others in the order of `others`, a permutation of all."""
        first = item % self.each % len(others)
        return np.array([first, *(grasp for grasp in others if grasp != first)][:count])

    @property
    def grasps(self) -> int:
        """How many grasps an object has, as far as the network can tell."""
        if self.config.touch:
            return int(self.split.arrays["vertices"].shape[1])
        return int(self.split.arrays["occluded"].shape[1]) if self.config.image == "occluded" else 1

    def name(self, item: int) -> str:
        """The item in words."""
        return f"{self.split.object_ids[item // self.each]} (first grasp {item % self.each % self.grasps})"


def arrays_of(config: NetworkConfig) -> tuple[str, ...]:
    """The arrays that a network of this configuration is trained on."""
    images = () if config.image is None else (config.image, "camera")
    return ("points", *images, *(("vertices", "stop_rule") if config.touch else ()))
