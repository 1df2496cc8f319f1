"""Predict an object's surface from a few grasps, and write it as a mesh file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.errors import StageError
from pipeline.inference.mesh_files import check_output, write_charts, write_closed, write_joined
from pipeline.inference.observation_reader import ObservationReader, object_mask
from pipeline.kernels.geometry.closed_surface import RESOLUTION
from pipeline.kernels.vision.vertex_colors import foreground, seen_colors
from pipeline.models.families import load_reconstructor, model_name, trained_models
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor, close_reconstruction
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Place, names_in
from pipeline.training.device import device_of

Surface = Literal["charts", "joined", "both", "closed"]


@dataclass(frozen=True)
class Prediction:
    """Describe the files that a prediction wrote.

    Attributes
    ----------
    files
        The mesh files.
    reconstruction
        The surface in them.
    touched
        (T,) bool, of the given sensors: whether their charts are part of it.
    closed
        The closed mesh, if it was asked for.
    """

    files: list[Path]
    reconstruction: Reconstruction
    touched: NDArray[np.bool_]
    closed: ClosedMesh | None = None


@dataclass(frozen=True)
class ClosedMesh:
    """Hold the closed mesh of a reconstruction.

    Attributes
    ----------
    vertices, faces
        (V, 3) float64 in the world, m, and (F, 3) int64, normals outwards.
    colors
        (V, 3) uint8, from the image.
    seen
        (V,) bool: whether the image shows the vertex; the others have no colour.
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
    """Reconstruct an object from a data directory or from files, and write its surface.

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
        poses in that camera's world, see `read_poses`. If the poses' file does not state which sensors touched, those did whose
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
    reader = ObservationReader(_load_model(models, configuration, training_seed, device), models, device, seed)
    if data is not None:
        if object_id is None or image is not None or tactile_images or poses is not None:
            raise StageError("give a data directory and an object, or files, not both")
        if models.resolve() == (data / "models").resolve():  # else the models are another dataset's
            DataDirectory(data).check_origins([model_name(configuration, training_seed)])
        observation = reader.of_object(data, object_id, [view] if reader.model.image == "rendering" else grasps)
    else:
        if object_id is not None:
            raise StageError(f"object {object_id} needs a data directory; name one, or leave the object out")
        observation = reader.of_files(image, tactile_images, poses)
    made = reader.model.reconstruct([observation])[0]
    if surface != "closed":
        return Prediction(_write(out, made, surface), made, observation.touched)
    mask = None if data is None or object_id is None else object_mask(data, object_id, reader.model.image, grasps)
    mesh = _close(made, observation, reader.model.camera, mask, resolution)
    write_closed(out, mesh.vertices, mesh.faces, mesh.colors, mesh.seen)
    return Prediction([out], made, observation.touched, mesh)


def _load_model(models: Place, configuration: str, training_seed: int, device: torch.device) -> Reconstructor:
    trained = trained_models(models, training_seed)
    if configuration not in trained:
        known = f"its models are {', '.join(sorted(trained))}" if trained else "there are none at all"
        meant = f"did you mean {models / 'models'}?" if "models" in names_in(models) else "train it with train-gcn, train-implicit, …"
        seed = f"seed-{training_seed}" if training_seed else ""
        raise StageError(f"{models / seed} has no model {configuration}: {known}; {meant}")
    return load_reconstructor(configuration, DataDirectory(trained[configuration]).whole_folder(configuration), device)


def _close(
    made: Reconstruction, given: Observation, camera: NDArray[np.float64] | None, mask: NDArray[np.bool_] | None, resolution: int
) -> ClosedMesh:
    """Close a reconstruction, and colour it by its image in the object's mask (rows, cols), or in front of the background."""
    vertices, faces = close_reconstruction(made, resolution, given)
    image, camera = given.image, camera if given.camera is None else given.camera
    if image is None or camera is None:
        return ClosedMesh(vertices, faces, np.zeros((len(vertices), 3), np.uint8), np.zeros(len(vertices), bool))
    return ClosedMesh(vertices, faces, *seen_colors(vertices, faces, image, camera, foreground(image) if mask is None else mask))


def _write(out: Path, made: Reconstruction, surface: Surface) -> list[Path]:
    if made.is_whole:  # joined already
        surface = "charts"
    beside = out.with_name(f"{out.stem}-joined{out.suffix}")
    files = {"charts": {out: write_charts}, "joined": {out: write_joined}, "both": {out: write_charts, beside: write_joined}}[surface]
    for path, write in files.items():
        write(path, made)
    return list(files)
