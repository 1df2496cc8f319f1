"""Training items: an object, the number and choice of its grasps; and their random variation, in colours, sensors and pose."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.dataset.object_rows import CACHE_MEGABYTES, ObjectRows
from pipeline.kernels.charts.touch_chart import SIDE
from pipeline.kernels.geometry.transforms import scaling_about, transform_points
from pipeline.kernels.metrics.chamfer import SearchCloud
from pipeline.kernels.networks.network_configurations import INPUT_CHOICES, ImageKind, NetworkInputs
from pipeline.kernels.vision.view_transfer import background_color, carried_camera, transfer_view
from pipeline.models.observation import (
    Observation,
    grasp_touches,
    observed_arrays,
    scale_of,
    stored_cameras,
    stored_images,
    stored_observation,
    stored_touches,
)
from pipeline.models.reconstruction import Trained
from pipeline.store.storage import Location
from pipeline.training.settings import ReconstructionSettings, TrainingSettings

TOUCHES = 2**14  # grasps whose touches are kept in memory, some 20 kB each: to find points of a gel takes 9 ms
TARGETS = 128  # objects whose points are kept in memory with their search tree, half a megabyte each


class _Kept:
    """Gives the last values that a function made, by its arguments; unlike an `lru_cache`, other processes can be sent it."""

    def __init__(self, make: Callable[..., Any], most: int) -> None:
        self._make, self._most, self._values = make, most, dict[Any, Any]()

    def __call__(self, *key: Any) -> Any:
        if key not in self._values:
            if len(self._values) == self._most:
                del self._values[next(iter(self._values))]  # the oldest
            self._values[key] = self._make(*key)
        return self._values[key]


class Items:
    """Read the objects of a split as a network's inputs; read only the arrays that it takes."""

    def __init__(
        self,
        data: Location,
        split: str,
        config: NetworkInputs,  # gives the image and whether the network takes touch
        items_per_object: int,  # each begins with another grasp; with fewer items than grasps, it is drawn
        *,
        learned: tuple[str, ...] = ("points",),  # arrays that the loss needs
        cache_megabytes: float = CACHE_MEGABYTES,
    ) -> None:
        self.rows = ObjectRows(data, (*learned, *observed_arrays(config)), split, cache_megabytes=cache_megabytes)
        self.config, self.items_per_object = config, items_per_object
        self._targets, self._touches = _Kept(self._read_target, TARGETS), _Kept(partial(grasp_touches, self.rows, config=config), TOUCHES)

    def __len__(self) -> int:
        return len(self.rows) * self.items_per_object

    @property
    def side(self) -> int:
        """Read the vertices along a side of the touch charts; the supplement's number for a network without them."""
        return math.isqrt(self.rows.size("vertices", "vertex")) if self.config.takes_charts else SIDE

    def scale(self, object_id: str) -> float:
        """Compute the factor that makes an object as large as networks learn them."""
        return scale_of(self.rows, object_id, self.config)

    def scaled(self, points: np.ndarray, object_id: str) -> np.ndarray:
        """Scale points (N, 3) of an object, world, m, as its observations are."""
        if (scale := self.scale(object_id)) == 1:
            return points
        return transform_points(scaling_about(self.config.centre, scale), points.astype(np.float64)).astype(np.float32)

    @property
    def resolution(self) -> tuple[int, int] | None:
        """Read the rows and columns of the images; None without them."""
        images = stored_images(self.config)
        return (self.rows.size(images[0], "row"), self.rows.size(images[0], "col")) if images else None

    def target(self, item: int) -> SearchCloud:
        """Read the object's points, (N, 3) float32, world, m, scaled as its observations are."""
        target: SearchCloud = self._targets(self.object_of(item))
        return target

    def _read_target(self, object_id: str) -> SearchCloud:
        return SearchCloud(torch.tensor(self.scaled(self.rows.read("points", object_id), object_id)))

    def object_of(self, item: int) -> str:
        """Name an item's object."""
        return self.rows.object_ids[item // self.items_per_object]

    def view(
        self,
        item: int,  # its number, from 0
        count: int,
        order: np.ndarray,  # permutation of all grasps, from which the further ones are taken
        inputs: NetworkInputs | None = None,  # of a network that takes any
    ) -> Observation:
        """Read the network's input of `count` grasps: the item's own, then further ones."""
        grasps = self.grasps_of(item, count, order)
        return stored_observation(self.rows, self.object_of(item), grasps, inputs or self.config, touches_of=self._touches)

    def grasps_of(self, item: int, count: int, order: np.ndarray) -> list[int]:
        """Choose the grasps, or the viewpoint, of an item; parameters as `view`."""
        first = item % self.items_per_object % len(order)
        if self.items_per_object < len(order):  # fewer items than grasps, or viewpoints: each of them comes first at some time
            first = int(order[first])
        return [first, *(grasp for grasp in order.tolist() if grasp != first)][:count]

    def random_view(
        self,
        item: int,  # its number, from 0
        fewest: int,
        most: int,
        generator: torch.Generator,  # draws the number and the further grasps
        *,
        # for a network that takes any inputs: shares of items without image, touches
        dropped: tuple[float, float] = (0.0, 0.0),
    ) -> Observation:
        """Read the network's input with `fewest` to `most` random grasps, the item's own first."""
        count = int(torch.randint(fewest, most + 1, (), generator=generator))
        order = torch.randperm(self.grasps, generator=generator).numpy()
        if self.config.image != "any":
            return self.view(item, count, order)
        image_draw, kind_draw, touch_draw = torch.rand(3, generator=generator, dtype=torch.float64).tolist()
        image: ImageKind | None = None if image_draw < dropped[0] else "occluded" if kind_draw < 0.5 else "unoccluded"
        return self.view(item, count, order, self.config.restricted_to(NetworkInputs(image=image, touch=touch_draw >= dropped[1])))

    def fixed_view(self, item: int, fewest: int, most: int) -> Observation:
        """Read the network's input with a fixed choice of grasps, in the order of the dataset.

        An object's items have `fewest` to `most` grasps in turn. Those of a network that takes any inputs have all
        `INPUT_CHOICES` in turn, each with more grasps the next time.
        """
        if self.config.image == "any":
            repetition, choice = divmod(item, len(INPUT_CHOICES))
            inputs = self.config.restricted_to([*INPUT_CHOICES.values()][choice])
            return self.view(item, fewest + repetition % (most - fewest + 1), np.arange(self.grasps), inputs)
        return self.view(item, fewest + item % self.items_per_object % (most - fewest + 1), np.arange(self.grasps))

    @property
    def grasps(self) -> int:
        """Count the grasps, or viewpoints, of an object that differ for the network."""
        if self.config.touch:
            return self.rows.size(stored_touches(self.config)[0], "grasp")
        if self.config.image == "rendering":
            return self.rows.size("rendering", "viewpoint")
        return self.rows.size("occluded", "grasp") if self.config.image == "occluded" else 1

    def trained(self, configuration: str, network: NetworkInputs) -> Trained:
        """Describe a network that was trained on these items."""
        diagonals = [self.rows.diagonal(object_id) for object_id in self.rows.object_ids]
        camera: Any = None
        background: Any = None
        drawn: Any = None
        if self.config.image not in (None, "rendering"):  # each rendering has its own camera
            camera = stored_cameras(self.rows, self.rows.object_ids[0], self.config)[0].tolist()
            if (scene := self.rows.attributes("vision").get("scene")) is not None:
                background = [int(255 * level + 0.5) for level in scene["background"]]
                drawn = scene["cameras"][0].get("drawn")
        return Trained(
            configuration=configuration,
            network=network,
            camera=camera,
            drawn=drawn,
            resolution=self.resolution,
            background=background,
            charts=self.rows.attributes("charts")["settings"] if self.config.takes_charts else None,
            gels=self._gels(),
            diagonals=(min(diagonals), max(diagonals)),
        )

    def _gels(self) -> tuple[float, float] | None:
        """Find the least and greatest width of a gel over the diagonal of its object; None if they are not read."""
        if not self.config.touch or self.config.takes_charts:
            return None
        diagonals, widths = map(self.rows.diagonal, self.rows.object_ids), [sensor.width for sensor in self.rows.sensors()]
        shares = [width / diagonal for diagonal in diagonals for width in widths]
        return min(shares), max(shares)

    def name(self, item: int) -> str:
        """Name an item's object, and its first grasp if that is fixed."""
        has_first_grasp = self.config.image != "rendering" and 1 < self.grasps <= self.items_per_object  # else it is the only one, or drawn
        return self.object_of(item) + (f" (first grasp {item % self.items_per_object % self.grasps})" if has_first_grasp else "")


def vary_image(
    image: np.ndarray,  # (H, W, 3) uint8
    settings: TrainingSettings,  # `image_gain`, `image_shift` and `image_noise`
    generator: torch.Generator,
) -> np.ndarray:  # (H, W, 3) uint8
    """Scale and shift the colours of an image, and add noise to its pixels; all settings at 0 leave it unchanged."""
    if not (settings.image_gain or settings.image_shift or settings.image_noise):
        return image
    scale = 1 + settings.image_gain * _within_one(3, generator)
    levels = torch.tensor(image, dtype=torch.float32) * scale + settings.image_shift * _within_one(3, generator)
    if settings.image_noise:
        levels += settings.image_noise * torch.randn(levels.shape, generator=generator, dtype=torch.float32)
    return np.asarray(levels.round_().clamp_(0, 255).to(torch.uint8).numpy())


def vary_observation(
    observation: Observation,
    settings: ReconstructionSettings,  # as of `vary_image`; `touch_dropout`: probability to skip a touch
    generator: torch.Generator,
) -> Observation:
    """Vary the image of an observation, and skip some of its touches."""
    if observation.image is not None:
        observation = replace(observation, image=vary_image(observation.image, settings, generator))
    if settings.touch_dropout:
        kept = (torch.rand(len(observation.touched), generator=generator, dtype=torch.float32) >= settings.touch_dropout).numpy()
        observation = replace(observation, touches=tuple(touch for touch, keep in zip(observation.touches, kept, strict=True) if keep))
    return observation


def draw_misplacement(
    deviation: float,  # of the shift along each axis, m, and of the logarithm of the scale in radii
    centre: Sequence[float],  # (3,) world, m, of the ball that objects lie in; they are scaled about it
    radius: float,  # of this ball, m
    generator: torch.Generator,
) -> NDArray[np.float64]:  # (4, 4) similarity, from where the object is to where it is taken to be
    """Draw the error of an object's estimated pose and size; a turn about +z is not among the errors."""
    *shift, scale = (deviation * torch.randn(4, generator=generator, dtype=torch.float64)).tolist()
    motion = scaling_about(centre, math.exp(scale / radius))
    motion[:3, 3] += shift
    return motion


def misplace(
    observation: Observation,  # with an image and its camera
    motion: NDArray[np.float64],  # (4, 4), from `draw_misplacement`
    centre: NDArray[np.float64],  # (3,) world, m, where the object is taken to be
) -> Observation:
    """Change an observation to what `predict` would make of it with a wrong estimate of the object's pose.

    The image shows `centre` where it showed the object's centre.
    """
    moved = observation.moved(motion)
    assert observation.image is not None
    assert observation.camera is not None
    assert moved.camera is not None
    turned = carried_camera(observation.camera, moved.camera, centre)
    rows, cols = observation.image.shape[:2]
    image, _ = transfer_view(observation.image, moved.camera, turned, (rows, cols), background_color(observation.image))
    return replace(moved, image=image, camera=turned)


def _within_one(count: int, generator: torch.Generator) -> Tensor:
    return 2 * torch.rand(count, generator=generator, dtype=torch.float32) - 1
