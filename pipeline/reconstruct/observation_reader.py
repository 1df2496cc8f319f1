"""Read the inputs of a trained network: image and touch charts of a stored object, or of a robot's observation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline.console import abbreviate
from pipeline.dataset.object_rows import ObjectRows, is_surface
from pipeline.errors import StageError, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.networks.network_configurations import NetworkInputs
from pipeline.kernels.touch.sensor import sensor_to_world
from pipeline.kernels.touch.touched_points import Touch, chart_touches
from pipeline.kernels.vision.scene import Label
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.touch_model import TouchModel, load_touch_model
from pipeline.reconstruct.object_location import Target
from pipeline.reconstruct.observation_placement import Placement, network_tactile_images
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, list_folder
from schemas.charts import CHARTS
from stages.fit_charts import ChartSettings

TOUCHES = ("tactile_image", "sensor_pose", "touch_success")  # arrays that charts are fitted to if none are stored


@dataclass(frozen=True)
class ObservationReader:
    """Read the inputs of a model; fit touch charts if none are stored."""

    model: Reconstructor
    models: Location  # folder of models, for the U-Net
    device: torch.device  # where the U-Net runs
    seed: int  # of the chart fitting
    training_seed: int = 0  # which training of the network the model is

    def of_object(self, data: Location, object_id: str, grasps: Sequence[int]) -> Observation:
        """Read an object of a data directory with some of its grasps; for a model of renderings, with one viewpoint."""
        if not grasps:
            raise StageError(f"{object_id}: name at least one grasp")
        config = self.model.config
        if not config.touch or DataDirectory(data).collection(CHARTS).shards:
            kind = "viewpoint" if config.image == "rendering" else "grasp"
            rows = open_object(data, observed_arrays(config), object_id, grasps, kind)
            if config.touch and (stored := rows.size("vertices", "vertex")) != config.side**2:
                raise StageError(
                    f"the touch charts of {data} have {stored} vertices, model {self.model.trained.configuration} takes {config.side**2}; "
                    f"run fit-charts with fit-charts.side={config.side}, or train the model on these"
                )
            return stored_observation(rows, object_id, grasps, config)
        rows = open_object(data, [*([config.image, "projection"] if config.image else []), *TOUCHES], object_id, grasps)
        seen = stored_observation(rows, object_id, grasps, config.model_copy(update={"touch": False}))
        tactile_images, poses, touched = (np.concatenate([rows.read(name, object_id, grasp) for grasp in grasps]) for name in TOUCHES)
        self.unet.check_sensor(rows.sensor())
        return replace(seen, touches=self._charts(tactile_images, poses, touched))

    def of_robot(self, placed: Placement) -> Observation:
        """Fit charts to a robot's touches; its image, and the depth that it gives as touched, are placed already."""
        if not self.model.config.touch:
            return Observation(placed.image, camera=placed.camera)
        observation, visible = placed.checked.observation, placed.visible_charts
        touches: tuple[Touch, ...] = ()
        if observation.touches:
            images = network_tactile_images(observation, self.unet.sensor, self.unet.untouched)
            shown = zip(observation.touches, observation.shown_touches, strict=True)
            touches = self._charts(images, placed.sensor_poses, [is_shown and touch.touched for touch, is_shown in shown])
        return Observation(placed.image, touches + chart_touches(visible, np.ones(len(visible), bool)), placed.camera)

    def restricted_to(self, inputs: NetworkInputs) -> Self:
        """Make a reader for a model that accepts any subset of inputs, and these inputs."""
        return replace(self, model=self.model.restricted_to(inputs))

    @cached_property
    def target(self) -> Target:
        """The model as observations are checked against it; no sensor if tactile images cannot be read."""
        sensor = self.unet.sensor if self.model.config.touch and f"{self._unet_name}.json" in list_folder(self.models) else None
        return Target.model_construct(**dict(self.model.trained), sensor=sensor)

    @cached_property
    def unet(self) -> TouchModel:
        """Load the network beside the models that makes the points for charts: the U-Net, or the local network."""
        if f"{self._unet_name}.json" not in list_folder(self.models):
            label = {"touch": "local network", "unet": "U-Net"}[self._unet_name]
            raise StageError(
                f"{self.models} has no {label}, which makes points of tactile images; name the models of a data directory with one"
            )
        return load_touch_model(DataDirectory(self.models).verified_folder(self._unet_name), self.device)

    @property
    def _unet_name(self) -> str:
        return "touch" if self._chart_settings.cloud == "local" else "unet"

    def _charts(
        self,
        tactile_images: NDArray[np.uint8],  # (T, rows, cols, 3)
        poses: NDArray[np.float64],  # (T, 4, 4) sensor frame to world, m
        touched: Sequence[bool | Literal["auto"]] | NDArray[np.bool_],  # (T,); "auto" for those that touched if they have points
    ) -> tuple[Touch, ...]:
        """Fit touch charts as in the model's training."""
        sensor, clouds = self.unet.sensor, self.unet.clouds(tactile_images)
        flags = np.array([len(cloud) > 0 if flag == "auto" else flag for cloud, flag in zip(clouds, touched, strict=True)])
        touched_clouds = [cloud if flag else cloud[:0] for cloud, flag in zip(clouds, flags, strict=True)]
        generators = [torch_generator(self.seed, "predict", number) for number in range(len(touched_clouds))]
        options = self._chart_settings.fit_options(sensor.width)
        fits = fit_charts(touched_clouds, sensor.width, generators, aspect=sensor.aspect, options=options)
        vertices = [sensor_to_world(pose, *chart.T) for pose, chart in zip(poses, fits.vertices, strict=True)]
        return chart_touches(np.array(vertices), flags & is_surface(fits.stop_rule))

    @cached_property
    def _chart_settings(self) -> ChartSettings:
        trained = self.model.trained
        try:
            settings = ChartSettings.model_validate(trained.charts)
        except ValidationError as error:
            raise StoreError(f"charts of model {trained.configuration}: {invalid_entries(error)}; train it again") from error
        if settings.side != trained.network.side:
            raise StoreError(
                f"model {trained.configuration} takes charts of side {trained.network.side}, but its record names fit-charts.side="
                f"{settings.side}; train it again"
            )
        return settings


def open_object(data: Location, arrays: Sequence[str], object_id: str, numbers: Sequence[int], kind: str = "grasp") -> ObjectRows:
    """Open arrays of a data directory, and check that an object with these grasps or viewpoints is there; a `StoreError` otherwise."""
    counted = "joint_angles" if kind == "grasp" else "rendering"  # their number
    rows = ObjectRows(data, sorted({*arrays, counted}), split=None)
    if object_id in rows.failed:
        raise StoreError(f"{object_id} failed in {rows.failed[object_id]}")
    if object_id not in rows.object_ids:
        raise StoreError(f"{data.resolve()} has no object {object_id}; it has {abbreviate(rows.object_ids)}")
    available = rows.size(counted, kind)
    if missing := [number for number in numbers if not 0 <= number < available]:
        raise StoreError(f"{object_id} has no {kind} {missing[0]}; there are {kind}s 0 to {available - 1}")
    if len(set(numbers)) < len(numbers):
        raise StoreError(f"{object_id}: {kind}s {', '.join(map(str, numbers))}; name each once")
    return rows


def object_mask(data: Location, object_id: str, image: str | None, grasps: Sequence[int]) -> NDArray[np.bool_]:
    """Read the (rows, cols) mask of the object in its stored image `unoccluded`, or `occluded` by the first grasp."""
    labels = ObjectRows(data, ["segmentation"], split=None).read("segmentation", object_id, camera=0)  # alone, then in each grasp
    return np.asarray(labels[0 if image == "unoccluded" else 1 + grasps[0]] == Label.OBJECT)
