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
from pipeline.dataset.object_rows import ObjectRows, is_surface, sensors_of
from pipeline.errors import StageError, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.networks.network_configurations import NetworkInputs
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.sensor import Sensor, resample, sensor_to_world
from pipeline.kernels.touch.touched_points import Touch, chart_touches, cloud_touch, gel_touch
from pipeline.kernels.vision.scene import Label
from pipeline.models.foreign_data import same_gel
from pipeline.models.observation import Observation, learned_touch, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.touch_model import TouchModel, load_touch_model, shipped_touch_model
from pipeline.reconstruct.object_location import Target
from pipeline.reconstruct.observation_checks import OF_POINTS
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import Placement, network_tactile_images
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, list_folder
from schemas.charts import CHARTS
from schemas.touch import TOUCH
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
        config, sensors = self.model.config, self.sensors_in(data)
        of_gels = config.touch and not (config.takes_charts and (self.is_of(data) or self._are_charted(sensors)))
        if of_gels and not config.of_points:
            names = ", ".join(dict.fromkeys(sensor.name for sensor in sensors))
            raise StageError(f"model {self.model.trained.configuration} takes touch charts of its sensor, not of {names}: {OF_POINTS}")
        return self._stored(data, object_id, grasps, of_gels=of_gels)

    def is_of(self, data: Location) -> bool:
        """Check whether the models are those of a data directory: they have learned its sizes, gels and cameras."""
        return self.models.resolve() == (data / "models").resolve()

    def sensors_in(self, data: Location) -> tuple[Sensor, ...]:
        """Read the sensors of a data directory's touches; none if the model takes no touch."""
        touch = DataDirectory(data).collection(TOUCH)
        return sensors_of(touch.first) if self.model.config.touch and touch.shards else ()

    def _are_charted(self, sensors: Sequence[Sensor]) -> bool:
        """Check whether sensors have the gel of those whose charts the model has learned from; one that is not known has."""
        ours = self.target.sensor
        return ours is None or all(same_gel(ours, sensor) for sensor in sensors)

    def _stored(self, data: Location, object_id: str, grasps: Sequence[int], *, of_gels: bool) -> Observation:
        """Read an observation from depth maps, stored charts, or tactile images to which charts are fitted."""
        config = self.model.config
        if of_gels or not config.touch or DataDirectory(data).collection(CHARTS).shards:
            kind = "viewpoint" if config.image == "rendering" else "grasp"
            rows = open_object(data, observed_arrays(config, of_gels=of_gels), object_id, grasps, kind)
            if config.touch and not of_gels and (stored := rows.size("vertices", "vertex")) != config.side**2:
                raise StageError(
                    f"the touch charts of {data} have {stored} vertices, model {self.model.trained.configuration} takes {config.side**2}; "
                    f"run fit-charts with fit-charts.side={config.side}, or train the model on these"
                )
            return stored_observation(rows, object_id, grasps, config, of_gels=of_gels)
        rows = open_object(data, [*([config.image, "projection"] if config.image else []), *TOUCHES], object_id, grasps)
        seen = stored_observation(rows, object_id, grasps, config.model_copy(update={"touch": False}))
        tactile_images, poses, touched = (np.concatenate([rows.read(name, object_id, grasp) for grasp in grasps]) for name in TOUCHES)
        self.unet.check_sensor(rows.sensor())
        return replace(seen, touches=self._charts(tactile_images, poses, touched))

    def of_robot(self, placed: Placement) -> Observation:
        """Fit charts to a robot's touches, or take points of its gels; its image and the depth that it gives as touched are placed."""
        if not self.model.config.touch:
            return Observation(placed.image, camera=placed.camera)
        observation, visible = placed.checked.observation, placed.visible_charts
        numbers = range(len(observation.touches))
        charted = [number for number in numbers if self.target.is_charted(observation.touches[number], observation.sensor_of(number))]
        touches = {number: self._gel(placed, number) for number in numbers if number not in charted}
        if charted:
            images = network_tactile_images(observation, charted, self.unet.sensor, self.unet.untouched)
            shown = [observation.shown_touches[number] and observation.touches[number].touched for number in charted]
            touches |= dict(zip(charted, self._charts(images, placed.sensor_poses[charted], shown), strict=True))
        given = tuple(touches[number] for number in numbers)
        return Observation(placed.image, given + chart_touches(visible, np.ones(len(visible), bool)), placed.camera)

    def _gel(self, placed: Placement, number: int) -> Touch:
        """Take points of a robot's gel, in the network's world."""
        observation, touch = placed.checked.observation, placed.checked.observation.touches[number]
        sensor, pose, is_shown = observation.sensor_of(number), observation.sensor_poses[number], observation.shown_touches[number]
        if touch.points is not None:
            points, outward = np.split(touch.points[: len(touch.points) * is_shown], 2, axis=1)
            felt = cloud_touch(points, -outward, sensor, pose, placed.factor, free=np.zeros((0, 3)))
        else:
            front, contact = self._front(observation, number)
            sensor = resample(sensor, *contact.shape)
            felt = gel_touch(front, contact & bool(is_shown), sensor, pose, placed.factor)
        return learned_touch(felt, sensor, pose, self.model.config).moved(placed.to_network)

    def _front(self, observation: RobotObservation, number: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Find a gel's front (rows, cols), m above the sensor plane, and its contact: as given, or as a network reads the photograph."""
        touch, sensor, ours = observation.touches[number], observation.sensor_of(number), self.target.sensor
        indentation, contact = touch.depth, touch.contact_pixels
        if touch.tactile_image is not None and ours is not None and same_gel(ours, sensor):
            images = network_tactile_images(observation, [number], self.unet.sensor, self.unet.untouched)
            depth, mask = self.unet.maps(images)
            return depth[0].astype(np.float64), mask[0]
        if touch.tactile_image is not None:
            model, aspect = shipped_touch_model(sensor, self.device), sensor.pitch[0] / sensor.pitch[1]
            gel = model.read(touch.tactile_image[None], observation.untouched_of(number), aspect)
            indentation, contact = gel.indentation[0].astype(np.float64), gel.contact[0]
        assert indentation is not None
        assert contact is not None
        return gel_surface(resample(sensor, *contact.shape)) - np.maximum(indentation, 0), contact

    def restricted_to(self, inputs: NetworkInputs) -> Self:
        """Make a reader for a model that accepts any subset of inputs, and these inputs."""
        return replace(self, model=self.model.restricted_to(inputs))

    @cached_property
    def target(self) -> Target:
        """The model as observations are checked against it; no sensor if no network beside it reads tactile images."""
        sensor = self.unet.sensor if self.model.config.touch and f"{self._unet_name}.json" in list_folder(self.models) else None
        return Target.model_construct(**dict(self.model.trained), sensor=sensor)

    @cached_property
    def unet(self) -> TouchModel:
        """Load the network beside the models that makes the points for charts: the U-Net, or the local network."""
        if f"{self._unet_name}.json" not in list_folder(self.models):
            label = {"touch": "local network", "unet": "U-Net"}[self._unet_name]
            raise StageError(f"{self.models} has no {label}, which makes points of tactile images; name the models of a dataset with one")
        return load_touch_model(DataDirectory(self.models).verified_folder(self._unet_name), self.device)

    @property
    def _unet_name(self) -> str:
        if self.model.trained.charts is None:
            return "touch" if "touch.json" in list_folder(self.models) else "unet"
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
