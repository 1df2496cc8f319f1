"""From one grasp, or a few, to a mesh file: tactile images to charts, charts and an image to a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.dataset.touch_charts import is_surface
from pipeline.errors import StageError
from pipeline.inference.grasp_input_files import read_image, read_poses, read_readings
from pipeline.inference.mesh_files import check_suffix, write_charts, write_joined
from pipeline.inference.stored_grasps import open_grasps
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.touch.sensor import Sensor, sensor_to_world
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor
from pipeline.models.touch_model import load_touch_model
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.training.device import device_of
from schemas.charts import CHARTS
from stages.fit_charts.settings import ChartSettings

TOUCHES = ("reading", "sensor_pose", "touch_success")
"""What charts are fitted to where none are stored."""
Surface = Literal["apart", "joined", "both"]


@dataclass(frozen=True)
class Prediction:
    """What was written, and of what.

    Attributes
    ----------
    files
        The mesh files.
    reconstruction
        What is in them.
    touched
        (T,) bool of the sensors given: whose charts are part of it.
    """

    files: list[Path]
    reconstruction: Reconstruction
    touched: NDArray[np.bool_]


def predict(
    out: Path,
    models: Path,
    configuration: str,
    *,
    data: Path | None = None,
    object_id: str | None = None,
    grasps: Sequence[int] = (0,),
    image: Path | None = None,
    readings: Sequence[Path] = (),
    poses: Path | None = None,
    surface: Surface = "both",
    accelerator: str = "auto",
    seed: int = 0,
) -> Prediction:
    """Reconstruct an object and write the surface: from a data directory, or from files of one's own.

    Parameters
    ----------
    out
        File to write, .obj, .ply or .glb. With `surface` "both" the charts go there, and the joined surface beside it under the
        same name with -joined. Metres, world frame (in GLB turned to y up).
    models, configuration
        A folder of models (DATA/models), and which of its gcn/ to use. Tactile images need its unet/ too.
    data, object_id, grasps
        From a data directory: an object, and the grasps to give; the occluded image is the first one's. Touch charts that are stored
        there are taken as they are.
    image, readings, poses
        From files: an image from the camera that the network was trained with; tactile images, one per sensor; and their sensors'
        poses in that camera's world, see `read_poses`. Where the poses' file does not say which sensors touched, those did whose
        tactile image differs from an untouched one.
    surface
        "apart", "joined" or "both".
    accelerator
        Where the networks run, "auto" on a GPU where there is one.
    seed
        Of the chart fitting.

    Raises
    ------
    StageError, StoreError, InvalidInput
        A model or an input that it needs is missing; an image's size or a chart's is not the one it was trained on; the suffix is no
        mesh's.
    """
    check_suffix(out)
    device = device_of(accelerator)
    observer = _Observer(_load(models / "gcn", configuration, device), models, device, seed)
    if data is not None:
        if object_id is None or image is not None or readings or poses is not None:
            raise StageError("from a data directory: name an object, and no files; from files: name no data directory")
        if models.resolve() == (data / "models").resolve():  # else the models are another dataset's
            DataDirectory(data).check_origins([f"models/gcn/{configuration}"])
        observation = observer.of_object(data, object_id, grasps)
    else:
        if object_id is not None:
            raise StageError(f"object {object_id} of which data directory? Name it, or leave the object out")
        observation = observer.of_files(image, readings, poses)
    made = observer.model.reconstruct([observation])[0]
    return Prediction(_write(out, made, surface), made, observation.touched)


def _load(folder: Path, configuration: str, device: torch.device) -> Reconstructor:
    if not (folder / f"{configuration}.json").is_file():
        there = ", ".join(sorted(path.stem for path in folder.glob("*.json"))) or "none"
        raise StageError(f"{folder} has no model {configuration} (there: {there}); train it with train-gcn")
    return Reconstructor(DataDirectory(folder).folder_path(configuration), device)


@dataclass(frozen=True)
class _Observer:
    """Collects what a model is given; touch charts are fitted where none are stored."""

    model: Reconstructor
    models: Path
    device: torch.device
    seed: int

    def of_object(self, data: Path, object_id: str, grasps: Sequence[int]) -> Observation:
        if not grasps:
            raise StageError(f"{object_id}: name a grasp at least")
        config = self.model.config
        if not config.touch or DataDirectory(data).collection(CHARTS).shards:
            rows = open_grasps(data, observed_arrays(config), object_id, grasps)
            return stored_observation(rows, object_id, grasps, config)
        images = () if config.image is None else (config.image,)
        rows = open_grasps(data, [*images, *TOUCHES], object_id, grasps)
        image = rows.read(config.image, object_id, grasps[0]) if config.image else None
        readings, poses, touched = (np.concatenate([rows.read(name, object_id, grasp) for grasp in grasps]) for name in TOUCHES)
        sensor = Sensor.model_validate(rows.attributes("touch")["sensor"])
        return self._felt(image, readings=readings, poses=poses, touched=touched, name=object_id, sensor=sensor)

    def of_files(self, image: Path | None, readings: Sequence[Path], poses: Path | None) -> Observation:
        model = self.model
        needed = [("an image", model.image, image), ("tactile images", model.touch, readings), ("the sensors' poses", model.touch, poses)]
        if missing := [what for what, needs, given in needed if needs and not given]:
            raise StageError(f"model {model.configuration} needs {' and '.join(missing)}, and none is given")
        if not model.touch and (readings or poses is not None):
            raise StageError(f"model {model.configuration} takes no touch: leave readings and poses out, or name one that does")
        seen = read_image(image) if model.image is not None and image is not None else None
        if poses is None:
            return Observation.without_touch(seen)
        felt, (placed, touched) = read_readings(readings), read_poses(poses)
        if len(felt) != len(placed):
            raise StageError(f"{len(felt)} tactile images and {len(placed)} poses in {poses}: there must be one pose per image, in order")
        return self._felt(seen, readings=felt, poses=placed, touched=touched, name="files")

    def _felt(
        self,
        image: NDArray[np.uint8] | None,
        *,
        readings: NDArray[np.uint8],
        poses: NDArray[np.float64],
        touched: NDArray[np.bool_] | None,
        name: str,
        sensor: Sensor | None = None,
    ) -> Observation:
        """Fit charts to what tactile images show, as those that the model was trained on; without flags, what shows points was touched."""
        unet = load_touch_model(DataDirectory(self.models).folder_path("unet"), self.device)
        unet.check_sensor(sensor or unet.sensor)
        width, clouds = unet.sensor.width, unet.clouds(readings)
        flags = np.array([len(cloud) > 0 for cloud in clouds], bool) if touched is None else touched
        given = [cloud if flag else cloud[:0] for cloud, flag in zip(clouds, flags, strict=True)]
        generators = [torch_generator(self.seed, "predict", name, number) for number in range(len(given))]
        options = ChartSettings.model_validate(self.model.chart_settings or {}).fit_options(width)
        fits = fit_charts(given, width, generators, options=options)
        vertices = [sensor_to_world(pose, *chart.T) for pose, chart in zip(poses, fits.vertices, strict=True)]  # (T, side², 3)
        return Observation(image, np.array(vertices, np.float32), flags & is_surface(fits.stop_rule))


def _write(out: Path, made: Reconstruction, surface: Surface) -> list[Path]:
    files = []
    if surface in ("apart", "both"):
        write_charts(out, made)
        files.append(out)
    if surface in ("joined", "both"):
        path = out.with_name(f"{out.stem}-joined{out.suffix}") if surface == "both" else out
        write_joined(path, made)
        files.append(path)
    return files
