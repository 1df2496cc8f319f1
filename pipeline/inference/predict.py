"""From one grasp, or a few, to a mesh file: tactile images to charts, charts and an image to a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline.dataset.object_rows import ObjectRows
from pipeline.dataset.touch_charts import is_surface
from pipeline.errors import StageError, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.formats.image_file import read_image
from pipeline.inference.grasp_input_files import read_poses, read_tactile_images
from pipeline.inference.mesh_files import check_output, write_charts, write_closed, write_joined
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.geometry.closed_surface import RESOLUTION
from pipeline.kernels.touch.sensor import sensor_to_world
from pipeline.kernels.vision.labels import Label
from pipeline.kernels.vision.vertex_colors import foreground, seen_colors
from pipeline.models.families import load_reconstructor, model_name, trained_models
from pipeline.models.observation import Observation, observed_arrays, stored_observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor, close_reconstruction
from pipeline.models.touch_model import TouchModel, load_touch_model
from pipeline.rng import torch_generator
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Place, names_in
from pipeline.training.device import device_of
from schemas.charts import CHARTS
from stages.fit_charts.settings import ChartSettings

TOUCHES = ("tactile_image", "sensor_pose", "touch_success")
"""What charts are fitted to where none are stored."""
Surface = Literal["charts", "joined", "both", "closed"]


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
    closed
        The closed mesh, where one was asked for.
    """

    files: list[Path]
    reconstruction: Reconstruction
    touched: NDArray[np.bool_]
    closed: ClosedMesh | None = None


@dataclass(frozen=True)
class ClosedMesh:
    """One closed mesh of a reconstruction.

    Attributes
    ----------
    vertices, faces
        (V, 3) float64 in the world, m, and (F, 3) int64, normals outwards.
    colors
        (V, 3) uint8, from the image.
    seen
        (V,) bool: which vertices the image shows; the others have no colour.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def predict(
    out: Path,
    models: Place,
    configuration: str,
    *,
    data: Place | None = None,
    object_id: str | None = None,
    grasps: Sequence[int] = (0,),
    view: int = 0,
    image: Path | None = None,
    tactile_images: Sequence[Path] = (),
    poses: Path | None = None,
    surface: Surface = "both",
    resolution: int = RESOLUTION,
    training_seed: int = 0,
    accelerator: str = "auto",
    seed: int = 0,
) -> Prediction:
    """Reconstruct an object and write the surface: from a data directory, or from files of one's own.

    Parameters
    ----------
    out
        File to write, .obj, .ply or .glb. With `surface` "both" the charts go there, and the joined surface beside it under the
        same name with -joined; an implicit network's one mesh goes there alone. Metres, world frame (in GLB turned to y up).
    models, configuration
        A folder of models (DATA/models), and which of its gcn/ or implicit/ to use, or "single-image". Tactile images need its unet/
        too.
    data, object_id, grasps, view
        From a data directory: an object, and the grasps to give; the occluded image is the first one's. Touch charts that are stored
        there are taken as they are. The single-image model is given the rendering from this viewpoint, in place of grasps.
    image, tactile_images, poses
        From files: an image from the camera that the network was trained with; tactile images, one per sensor; and their sensors'
        poses in that camera's world, see `read_poses`. Where the poses' file does not say which sensors touched, those did whose
        tactile image differs from an untouched one.
    surface
        "charts", "joined" or "both"; or "closed": one closed, smooth mesh within 0.5 mm of the touch charts, coloured where the image shows
        it and grey elsewhere.
    resolution
        Edges of the closed mesh along the longest side of its box.
    accelerator
        Where the networks run, "auto" on a GPU where there is one.
    training_seed, seed
        Of which training the network is; of the chart fitting.

    Raises
    ------
    StageError, StoreError, InvalidInput
        A model or an input that it needs is missing; an image's size or a chart's is not the one it was trained on; the suffix is no
        mesh's.
    """
    check_output(out)
    device = device_of(accelerator)
    observer = _Observer(_load(models, configuration, training_seed, device), models, device, seed)
    if data is not None:
        if object_id is None or image is not None or tactile_images or poses is not None:
            raise StageError("from a data directory: name an object, and no files; from files: name no data directory")
        if models.resolve() == (data / "models").resolve():  # else the models are another dataset's
            DataDirectory(data).check_origins([model_name(configuration, training_seed)])
        observation = observer.of_object(data, object_id, [view] if observer.model.image == "rendering" else grasps)
    else:
        if object_id is not None:
            raise StageError(f"object {object_id} of which data directory? Name it, or leave the object out")
        observation = observer.of_files(image, tactile_images, poses)
    made = observer.model.reconstruct([observation])[0]
    if surface != "closed":
        return Prediction(_write(out, made, surface), made, observation.touched)
    shown = None if data is None or object_id is None else _shown(data, object_id, observer.model.image, grasps)
    mesh = _close(made, observation, observer.model.camera, shown, resolution)
    write_closed(out, mesh.vertices, mesh.faces, mesh.colors, mesh.seen)
    return Prediction([out], made, observation.touched, mesh)


def _load(models: Place, configuration: str, training_seed: int, device: torch.device) -> Reconstructor:
    there = trained_models(models, training_seed)
    if configuration not in there:
        known = f"its models are {', '.join(sorted(there))}" if there else "there are none at all"
        meant = f"did you mean {models / 'models'}?" if "models" in names_in(models) else "train it with train-gcn, train-implicit, …"
        seed = f"seed-{training_seed}" if training_seed else ""
        raise StageError(f"{models / seed} has no model {configuration}: {known}; {meant}")
    return load_reconstructor(configuration, DataDirectory(there[configuration]).whole_folder(configuration), device)


@dataclass(frozen=True)
class _Observer:
    """Collects what a model is given; touch charts are fitted where none are stored."""

    model: Reconstructor
    models: Place
    device: torch.device
    seed: int

    def of_object(self, data: Place, object_id: str, grasps: Sequence[int]) -> Observation:
        if not grasps:
            raise StageError(f"{object_id}: name a grasp at least")
        config = self.model.config
        if config.image == "rendering":
            return stored_observation(_open(data, observed_arrays(config), object_id, grasps, "viewpoint"), object_id, grasps, config)
        if not config.touch or DataDirectory(data).collection(CHARTS).shards:
            rows = _open(data, observed_arrays(config), object_id, grasps)
            if config.touch and (stored := rows.size("vertices", "vertex")) != config.side**2:
                raise StageError(
                    f"the touch charts of {data} have {stored} vertices, model {self.model.configuration} takes {config.side**2}; "
                    f"run fit-charts with fit-charts.side={config.side}, or train the model on these"
                )
            return stored_observation(rows, object_id, grasps, config)
        rows = _open(data, [*([config.image] if config.image else []), *TOUCHES], object_id, grasps)
        image = rows.read(config.image, object_id, grasps[0], camera=0) if config.image else None
        tactile_images, poses, touched = (np.concatenate([rows.read(name, object_id, grasp) for grasp in grasps]) for name in TOUCHES)
        self.unet.check_sensor(rows.sensor())
        return Observation(image, *self._charts(tactile_images, poses, touched, object_id))

    def of_files(self, image: Path | None, tactile_images: Sequence[Path], poses: Path | None) -> Observation:
        model = self.model
        if model.image == "rendering":
            raise StageError(f"model {model.configuration} needs the camera of its image: name a data directory, an object and a viewpoint")
        needed = [
            ("an image", model.image, image),
            ("tactile images", model.touch, tactile_images),
            ("the sensors' poses", model.touch, poses),
        ]
        if missing := [what for what, needs, given in needed if needs and not given]:
            raise StageError(f"model {model.configuration} needs {' and '.join(missing)}, and none is given")
        if model.image is None and image is not None:
            raise StageError(f"model {model.configuration} takes no image: leave it out, or name one that does")
        if not model.touch and (tactile_images or poses is not None):
            raise StageError(f"model {model.configuration} takes no touch: leave tactile images and poses out, or name one that does")
        seen = read_image(image) if model.image is not None and image is not None else None
        if poses is None:
            return Observation(seen)
        felt, (placed, touched) = read_tactile_images(tactile_images), read_poses(poses)
        if len(felt) != len(placed):
            raise StageError(f"{len(felt)} tactile images and {len(placed)} poses in {poses}: there must be one pose per image, in order")
        return Observation(seen, *self._charts(felt, placed, touched, "files"))

    @cached_property
    def unet(self) -> TouchModel:
        """Load the U-Net beside the models."""
        if "unet.json" not in names_in(self.models):
            raise StageError(
                f"{self.models} has no U-Net, which makes points of tactile images; name the models of a data directory with one"
            )
        return load_touch_model(DataDirectory(self.models).whole_folder("unet"), self.device)

    def _charts(
        self, tactile_images: NDArray[np.uint8], poses: NDArray[np.float64], touched: NDArray[np.bool_] | None, name: str
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Fit charts (T, side², 3), world, m, as those that the model was trained on; (T,) which touched: unless told, all with points."""
        width, clouds = self.unet.sensor.width, self.unet.clouds(tactile_images)
        flags = np.array([len(cloud) > 0 for cloud in clouds]) if touched is None else touched
        given = [cloud if flag else cloud[:0] for cloud, flag in zip(clouds, flags, strict=True)]
        generators = [torch_generator(self.seed, "predict", name, number) for number in range(len(given))]
        fits = fit_charts(given, width, generators, options=self._chart_settings().fit_options(width))
        vertices = [sensor_to_world(pose, *chart.T) for pose, chart in zip(poses, fits.vertices, strict=True)]
        return np.array(vertices, np.float32), flags & is_surface(fits.stop_rule)

    def _chart_settings(self) -> ChartSettings:
        try:
            settings = ChartSettings.model_validate(self.model.chart_settings)
        except ValidationError as error:
            raise StoreError(f"charts of model {self.model.configuration}: {invalid_entries(error)}; run train-gcn again") from error
        if settings.side != self.model.config.side:
            raise StoreError(
                f"model {self.model.configuration} takes charts of side {self.model.config.side}, and says that they were fitted with "
                f"{settings.side}; run train-gcn again"
            )
        return settings


def _open(data: Place, arrays: Sequence[str], object_id: str, chosen: Sequence[int], kind: str = "grasp") -> ObjectRows:
    """Open these arrays of a data directory, in which there must be an object with these grasps, or viewpoints.

    Raises
    ------
    StoreError
        There is no such object, it failed, or it has no such grasp or viewpoint.
    """
    counted = "joint_angles" if kind == "grasp" else "rendering"  # which says how many there are
    rows = ObjectRows(data, sorted({*arrays, counted}), split=None)
    if object_id in rows.left_out:
        raise StoreError(f"{object_id} failed in {rows.left_out[object_id]}")
    if object_id not in rows.object_ids:
        few = ", ".join(rows.object_ids[:5])
        raise StoreError(f"{data.resolve()} has no object {object_id}; it has {few}{', …' if len(rows) > 5 else ''}")
    available = rows.size(counted, kind)
    if wrong := [number for number in chosen if not 0 <= number < available]:
        raise StoreError(f"{object_id} has no {kind} {wrong[0]}; there are {kind}s 0 to {available - 1}")
    return rows


def _close(
    made: Reconstruction, given: Observation, camera: NDArray[np.float64] | None, shown: NDArray[np.bool_] | None, resolution: int
) -> ClosedMesh:
    """Close a reconstruction, and colour it; where nobody says where its image shows the object, what is no background does."""
    vertices, faces = close_reconstruction(made, resolution, given)
    image, camera = given.image, camera if given.camera is None else given.camera
    if image is None or camera is None:
        return ClosedMesh(vertices, faces, np.zeros((len(vertices), 3), np.uint8), np.zeros(len(vertices), bool))
    return ClosedMesh(vertices, faces, *seen_colors(vertices, faces, image, camera, foreground(image) if shown is None else shown))


def _shown(data: Place, object_id: str, image: str | None, grasps: Sequence[int]) -> NDArray[np.bool_] | None:
    """Read where a stored image shows the object, and neither hand nor background."""
    if image not in ("occluded", "unoccluded"):
        return None
    labels = ObjectRows(data, ["segmentation"], split=None).read("segmentation", object_id, camera=0)  # alone, then in each grasp
    return np.asarray(labels[0 if image == "unoccluded" else 1 + grasps[0]] == Label.OBJECT)


def _write(out: Path, made: Reconstruction, surface: Surface) -> list[Path]:
    if made.is_whole:  # joined already
        surface = "charts"
    beside = out.with_name(f"{out.stem}-joined{out.suffix}")
    files = {"charts": {out: write_charts}, "joined": {out: write_joined}, "both": {out: write_charts, beside: write_joined}}[surface]
    for path, write in files.items():
        write(path, made)
    return list(files)
