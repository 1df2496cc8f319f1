"""Read the inputs of a trained network: image and touch charts of a stored object, or of a robot's observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline.console import abbreviate
from pipeline.dataset.object_rows import ObjectRows
from pipeline.dataset.touch_charts import is_surface
from pipeline.errors import StageError, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.touch.sensor import sensor_to_world
from pipeline.kernels.vision.scene import Label
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.touch_model import TouchModel, load_touch_model
from pipeline.reconstruct.model_inputs import ModelInputs, used_inputs
from pipeline.reconstruct.object_box import shows_touch
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import Placement, network_tactile_images
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, list_folder
from schemas.charts import CHARTS
from stages.fit_charts.settings import ChartSettings

TOUCHES = ("tactile_image", "sensor_pose", "touch_success")
"""Arrays that charts are fitted to if none are stored."""


@dataclass(frozen=True)
class ObservationReader:
    """Read the inputs of a model; fit touch charts if none are stored.

    Attributes
    ----------
    model
        The model that gets the inputs.
    models
        The folder of models, for the U-Net.
    device
        Where the U-Net runs.
    seed
        Of the chart fitting.
    training_seed
        Which training of the network the model is.
    """

    model: Reconstructor
    models: Location
    device: torch.device
    seed: int
    training_seed: int = 0

    def of_object(self, data: Location, object_id: str, grasps: Sequence[int]) -> Observation:
        """Read an object of a data directory with some of its grasps, from 0; for a model of renderings, with one viewpoint.

        Raises
        ------
        StageError
            `grasps` is empty, or touch charts have another size than the model takes.
        """
        if not grasps:
            raise StageError(f"{object_id}: name at least one grasp")
        config = self.model.config
        if config.image == "rendering":
            return stored_observation(open_object(data, observed_arrays(config), object_id, grasps, "viewpoint"), object_id, grasps, config)
        if not config.touch or DataDirectory(data).collection(CHARTS).shards:
            rows = open_object(data, observed_arrays(config), object_id, grasps)
            if config.touch and (stored := rows.size("vertices", "vertex")) != config.side**2:
                raise StageError(
                    f"the touch charts of {data} have {stored} vertices, model {self.model.configuration} takes {config.side**2}; "
                    f"run fit-charts with fit-charts.side={config.side}, or train the model on these"
                )
            return stored_observation(rows, object_id, grasps, config)
        rows = open_object(data, [*([config.image, "projection"] if config.image else []), *TOUCHES], object_id, grasps)
        seen = stored_observation(rows, object_id, grasps, config.model_copy(update={"touch": False}))
        tactile_images, poses, touched = (np.concatenate([rows.read(name, object_id, grasp) for grasp in grasps]) for name in TOUCHES)
        self.unet.check_sensor(rows.sensor())
        vertices, touched = self._charts(tactile_images, poses, touched)
        return replace(seen, touch_vertices=vertices, touched=touched)

    def of_robot(self, placed: Placement) -> Observation:
        """Fit charts to a robot's touches, and to the depth that it gives as touched; its image is placed already."""
        touches = placed.observation.touches
        if not self.model.touch:
            return Observation(placed.image, camera=placed.camera)
        vertices, touched = np.zeros((0, self.model.config.side**2, 3), np.float32), np.zeros(0, bool)
        if touches:
            images = network_tactile_images(placed.observation, self.unet.sensor, self.unet.untouched)
            flags = [shows_touch(touch, placed.observation) and touch.touched for touch in touches]
            vertices, touched = self._charts(images, placed.sensor_poses, flags)
        visible = placed.visible_charts(self.model.config.side)
        return Observation(
            placed.image, np.concatenate([vertices, visible]), np.concatenate([touched, np.ones(len(visible), bool)]), placed.camera
        )

    def suited_to(self, observed: RobotObservation) -> ObservationReader:
        """Return a reader for an observation; a model that takes any inputs gets those that are present."""
        return replace(self, model=self.model.restricted_to(used_inputs(self.model.config, observed)))

    @cached_property
    def inputs(self) -> ModelInputs:
        """Inputs that the model was trained with; no sensor if tactile images cannot be read."""
        model = self.model
        sensor = self.unet.sensor if model.touch and self._has_unet() else None
        return ModelInputs(model.configuration, model.config, model.camera, model.resolution, model.background, sensor, model.diagonals)

    @cached_property
    def unet(self) -> TouchModel:
        """Load the network beside the models that makes the points for charts: the U-Net, or the local network."""
        name, label = self._unet_name()
        if not self._has_unet():
            raise StageError(
                f"{self.models} has no {label}, which makes points of tactile images; name the models of a data directory with one"
            )
        return load_touch_model(DataDirectory(self.models).verified_folder(name), self.device)

    def _unet_name(self) -> tuple[str, str]:
        """Name its folder below the models, and what it is."""
        return ("touch", "local network") if self._chart_settings().cloud == "local" else ("unet", "U-Net")

    def _has_unet(self) -> bool:
        return f"{self._unet_name()[0]}.json" in list_folder(self.models)

    def _charts(
        self, tactile_images: NDArray[np.uint8], poses: NDArray[np.float64], touched: Sequence[bool | Literal["auto"]] | NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Fit touch charts as in the model's training.

        Parameters
        ----------
        tactile_images
            (T, rows, cols, 3) uint8.
        poses
            (T, 4, 4) sensor frame to world, m.
        touched
            (T,); "auto" for tactile images that touched if they have points.

        Returns
        -------
        (T, side², 3) vertices, world, m, and (T,) bool: which sensors have a chart.
        """
        sensor, clouds = self.unet.sensor, self.unet.clouds(tactile_images)
        flags = np.array([len(cloud) > 0 if flag == "auto" else flag for cloud, flag in zip(clouds, touched, strict=True)])
        touched_clouds = [cloud if flag else cloud[:0] for cloud, flag in zip(clouds, flags, strict=True)]
        generators = [torch_generator(self.seed, "predict", number) for number in range(len(touched_clouds))]
        options = self._chart_settings().fit_options(sensor.width)
        fits = fit_charts(touched_clouds, sensor.width, generators, aspect=sensor.aspect, options=options)
        vertices = [sensor_to_world(pose, *chart.T) for pose, chart in zip(poses, fits.vertices, strict=True)]
        return np.array(vertices, np.float32), flags & is_surface(fits.stop_rule)

    def _chart_settings(self) -> ChartSettings:
        try:
            settings = ChartSettings.model_validate(self.model.chart_settings)
        except ValidationError as error:
            raise StoreError(f"charts of model {self.model.configuration}: {invalid_entries(error)}; train it again") from error
        if settings.side != self.model.config.side:
            raise StoreError(
                f"model {self.model.configuration} takes charts of side {self.model.config.side}, but its record names fit-charts.side="
                f"{settings.side}; train it again"
            )
        return settings


def open_object(data: Location, arrays: Sequence[str], object_id: str, numbers: Sequence[int], kind: str = "grasp") -> ObjectRows:
    """Open arrays of a data directory, and check that an object with these grasps or viewpoints, from 0, is there.

    Raises
    ------
    StoreError
        The object is missing or failed, has no such grasp or viewpoint, or one of them is chosen twice.
    """
    counted = "joint_angles" if kind == "grasp" else "rendering"  # their number
    rows = ObjectRows(data, sorted({*arrays, counted}), split=None)
    if object_id in rows.left_out:
        raise StoreError(f"{object_id} failed in {rows.left_out[object_id]}")
    if object_id not in rows.object_ids:
        raise StoreError(f"{data.resolve()} has no object {object_id}; it has {abbreviate(rows.object_ids)}")
    available = rows.size(counted, kind)
    if missing := [number for number in numbers if not 0 <= number < available]:
        raise StoreError(f"{object_id} has no {kind} {missing[0]}; there are {kind}s 0 to {available - 1}")
    if len(set(numbers)) < len(numbers):
        raise StoreError(f"{object_id}: {kind}s {', '.join(map(str, numbers))}; name each once")
    return rows


def object_mask(data: Location, object_id: str, image: str | None, grasps: Sequence[int]) -> NDArray[np.bool_] | None:
    """Read the (rows, cols) mask of the object in the image of a stored array; None if the model takes no such image.

    The occluded image is that of the first grasp.
    """
    if image not in ("occluded", "unoccluded"):
        return None
    labels = ObjectRows(data, ["segmentation"], split=None).read("segmentation", object_id, camera=0)  # alone, then in each grasp
    return np.asarray(labels[0 if image == "unoccluded" else 1 + grasps[0]] == Label.OBJECT)
