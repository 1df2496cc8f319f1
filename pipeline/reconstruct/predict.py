"""Predict an object's surface from stored grasps or a robot's observation, and write it as a mesh file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter, errors, pluralise
from pipeline.errors import InvalidInput, StageError
from pipeline.kernels.geometry.closed_surface import RESOLUTION
from pipeline.kernels.networks.network_configurations import INPUT_CHOICES
from pipeline.kernels.vision.view_transfer import foreground
from pipeline.models.families import load_reconstructor, model_name, trained_folder, trained_models
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction, close_reconstruction
from pipeline.models.shipped_weights import DEFAULT, SHIPPED, shipped_models
from pipeline.reconstruct.closed_mesh import ClosedMesh
from pipeline.reconstruct.mesh_files import check_output, write_charts, write_closed, write_joined
from pipeline.reconstruct.model_inputs import learned_size
from pipeline.reconstruct.network_error import error_note
from pipeline.reconstruct.object_box import turn_to_z
from pipeline.reconstruct.observation_checks import faults
from pipeline.reconstruct.observation_file import RobotObservation, load_observation, read_entries
from pipeline.reconstruct.observation_placement import describe_object, place_observation
from pipeline.reconstruct.observation_reader import ObservationReader, object_mask
from pipeline.reconstruct.prediction_warnings import guessed_surface_warning, unseen_touches, view_warning
from pipeline.store.directory import DataDirectory
from pipeline.store.origins import check_origins
from pipeline.store.storage import Location
from pipeline.training.device import device_of

Surface = Literal["charts", "joined", "both", "closed"]


@dataclass(frozen=True)
class Prediction:
    """Describe a predicted surface and the files that hold it.

    Attributes
    ----------
    reconstruction
        The surface, in the world, m, or in the observation's frame and unit.
    touched
        (T,) bool, of the given sensors: whether their charts are part of it.
    visible
        How many patches of the visible surface were given as touched.
    closed
        The closed mesh, if it was asked for.
    metres_per_unit, up
        Of the lengths, and the direction that is up.
    remarks
        What was assumed of an observation, how it differs from the network's training, and what is known of the network's error.
    files
        The mesh files; none if it was not written.
    """

    reconstruction: Reconstruction
    touched: NDArray[np.bool_]
    visible: int = 0
    closed: ClosedMesh | None = None
    metres_per_unit: float = 1.0
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    remarks: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        surface = self.closed or self.reconstruction
        return f"Prediction({len(surface.vertices)} vertices, {len(surface.faces)} faces, {self.given_places})"

    @property
    def given_places(self) -> str:
        """Count, in words, the places on the surface that were given."""
        given = ((int(self.touched.sum()), "touch"), (self.visible, "visible patch"))
        return " and ".join(pluralise(count, name) for count, name in given if count) or "no touch, so that no place of it is certain"


def predict(
    out: Path,
    models: Location,
    configuration: str,
    *,
    data: Location | None = None,
    object_id: str | None = None,
    grasps: Sequence[int] | None = None,
    view: int = 0,
    observation: Path | RobotObservation | None = None,
    surface: Surface = "both",
    resolution: int = RESOLUTION,
    training_seed: int = 0,
    accelerator: str = "auto",
    seed: int = 0,
) -> Prediction:
    """Reconstruct an object from a data directory or from a robot's observation, and write its surface.

    Parameters
    ----------
    out
        File to write, .obj, .ply or .glb. With `surface` "both" the charts go there, and the joined surface beside it under the
        same name with -joined; an implicit network's one mesh goes there alone. Metres, world frame, or the observation's unit and frame;
        GLB is in metres, and y up.
    models, configuration
        A folder of models (DATA/models), and which of its gcn/ or implicit/ to use, or "single-image". Tactile images need its unet/
        too. "implicit-any" is given whatever the observation has, of a data directory the occluded image and the touches;
        "implicit-any-touch" and its like are given that alone.
    data, object_id, grasps, view
        From a data directory: an object, and the grasps to give, by default grasp 0; the occluded image is the first one's. Touch charts
        that are stored there are taken as they are. The single-image model is given the rendering from this viewpoint, in place of grasps.
    observation
        In place of these: what a robot saw and felt, or the file that describes it. Networks without inputs need none.
    surface
        "charts", "joined" or "both"; or "closed": one closed, smooth mesh, of an object of half a metre within 0.5 mm of the touch charts,
        coloured where the image shows it and grey elsewhere.
    resolution
        Edges of the closed mesh along the longest side of its box, 64 or more.
    accelerator
        Where the networks run, "auto" on a GPU where there is one.
    training_seed, seed
        Of which training the network is; of the chart fitting.

    Raises
    ------
    StageError, StoreError, InvalidInput
        A model or an input that it needs is missing; a chart's size is not the one it was trained on; the observation has faults, all of
        which are named; the suffix is no mesh's.
    """
    check_output(out)
    if data is None and isinstance(observation, Path):
        read_entries(observation)  # before networks are read, which takes longer
    with Meter(errors, "predict", 3, "steps", after=1.0) as meter:
        reader = model_reader(models, configuration, training_seed, accelerator, seed)
        meter.advance("the network is read")
        if data is None:
            if object_id is not None:
                raise StageError(f"object {object_id} needs a data directory; name one, or leave the object out")
            prediction = _of_robot(reader, observation, surface, resolution)
        else:
            if observation is not None:
                raise StageError("give a data directory and an object, or an observation, not both")
            if object_id is None:
                raise StageError(f"data directory {data} needs an object; name one of its objects")
            selected = _views(configuration, view, grasps) if reader.model.image == "rendering" else _grasps(configuration, view, grasps)
            if models.resolve() == (data / "models").resolve():  # else the models are another dataset's
                check_origins(DataDirectory(data), [model_name(configuration, training_seed)])
            prediction = _of_object(reader, data, object_id, selected, surface, resolution)
        meter.advance("the surface is made")
        prediction = replace(prediction, files=_write(out, prediction, surface))
        meter.advance("and written")
    return prediction


def _views(configuration: str, view: int, grasps: Sequence[int] | None) -> Sequence[int]:
    """Choose the viewpoint of the rendering that a model is given."""
    if grasps:
        raise StageError(f"model {configuration} takes no grasps, which {grasps[0]} is one of; choose a view")
    return [view]


def _grasps(configuration: str, view: int, grasps: Sequence[int] | None) -> Sequence[int]:
    """Choose the grasps that a model is given."""
    if view:
        raise StageError(f"model {configuration} takes no renderings, which view {view} is one of; choose grasps")
    return [0] if grasps is None else grasps


def chosen_models(
    models: Location | None, data: Location | None, configuration: str | None, training_seed: int = 0
) -> tuple[Location, str]:
    """Choose the folder of models, and the network.

    Parameters
    ----------
    models, data
        As they were named: a folder of models, else that of a data directory if it holds some, else the weights that ship.
    configuration
        The network; by default `occluded-touch`, of shipped weights the one that takes whatever there is.
    training_seed
        Of its training.

    Raises
    ------
    StageError
        Nothing is named, and no weights ship, or not of this training.
    """
    if models is None and data is not None and (trained_models(data / "models", training_seed) or not trained_models(SHIPPED)):
        models = data / "models"
    if models is None and training_seed:
        raise StageError(f"the network that ships has one training; name models of training seed {training_seed}, or leave it out")
    folder = shipped_models() if models is None else models
    return folder, configuration or (DEFAULT if folder == SHIPPED else "occluded-touch")


def reconstruct(
    observation: Path | RobotObservation,
    models: Location,
    configuration: str,
    *,
    resolution: int = RESOLUTION,
    training_seed: int = 0,
    accelerator: str = "auto",
    seed: int = 0,
) -> Prediction:
    """Reconstruct an object from a robot's observation, with a closed mesh, and write nothing; parameters and errors as `predict`."""
    return _of_robot(model_reader(models, configuration, training_seed, accelerator, seed), observation, "closed", resolution)


def model_reader(
    models: Location, configuration: str, training_seed: int = 0, accelerator: str = "auto", seed: int = 0
) -> ObservationReader:
    """Load a model and the reader of its inputs."""
    device = device_of(accelerator)
    model = load_reconstructor(configuration, trained_folder(models, configuration, training_seed), device)
    return ObservationReader(model, models, device, seed, training_seed)


def _of_robot(reader: ObservationReader, observation: Path | RobotObservation | None, surface: Surface, resolution: int) -> Prediction:
    """Reconstruct from a robot's observation, in its frame and unit."""
    model = reader.model
    if observation is None:
        if model.image or model.touch:
            needed_inputs = [name for name, is_used in (("an image", model.image), ("touches", model.touch)) if is_used]
            needed = (" or " if model.image == "any" else " and ").join(needed_inputs)
            raise StageError(f"model {model.configuration} needs {needed}: give an observation, or a data directory and an object")
        empty = Observation(None, scale=2 * model.config.radius / learned_size(reader.inputs))
        reconstruction = model.reconstruct([empty])[0]
        closed = ClosedMesh.grey(*close_reconstruction(reconstruction, resolution)) if surface == "closed" else None
        return Prediction(reconstruction, empty.touched, closed=closed, remarks=[error_note(reader)])
    if isinstance(observation, RobotObservation):
        observed = observation
        if lines := faults(observed, reader.inputs):
            raise InvalidInput(f"observation: {'; '.join(lines)}")
    else:
        observed = load_observation(observation, lambda part: faults(part, reader.inputs))
    reader = reader.suited_to(observed)
    placed = place_observation(observed, reader.inputs)
    network_inputs = reader.of_robot(placed)
    reconstruction = reader.model.reconstruct([network_inputs])[0]
    touched, visible = np.split(network_inputs.touched, [len(observed.touches)])
    remarks = [
        describe_object(observed, placed.box),
        *placed.remarks,
        *unseen_touches(observed, touched),
        *guessed_surface_warning(reconstruction),
    ]
    prediction = Prediction(
        replace(reconstruction, vertices=placed.returned(reconstruction.vertices)),
        touched,
        len(visible),
        metres_per_unit=observed.metres_per_unit,
        up=observed.up,
        remarks=[*remarks, error_note(reader)],
    )
    if surface != "closed":
        return prediction
    vertices, faces = close_reconstruction(reconstruction, resolution, network_inputs)
    mesh = ClosedMesh.grey(placed.returned(vertices), faces)
    if observed.camera is not None and observed.projection is not None:
        matrix = observed.projection * [*(3 * [observed.metres_per_unit]), 1.0]  # of points in the observation's unit
        mesh = mesh.coloured(observed.camera.image, matrix, observed.camera.object_pixels)
    return replace(prediction, closed=mesh)


def _of_object(
    reader: ObservationReader, data: Location, object_id: str, numbers: Sequence[int], surface: Surface, resolution: int
) -> Prediction:
    """Reconstruct from grasps of a data directory, or from the rendering of a viewpoint."""
    if reader.model.image == "any":
        reader = replace(reader, model=reader.model.restricted_to(INPUT_CHOICES["occluded-touch"]))
    model = reader.model
    network_inputs = reader.of_object(data, object_id, numbers)
    reconstruction = model.reconstruct([network_inputs])[0]
    remarks = [*view_warning(model, network_inputs), *guessed_surface_warning(reconstruction), error_note(reader)]
    prediction = Prediction(reconstruction, network_inputs.touched, remarks=remarks)
    if surface != "closed":
        return prediction
    mesh = ClosedMesh.grey(*close_reconstruction(reconstruction, resolution, network_inputs))
    if network_inputs.image is not None and network_inputs.camera is not None:
        mask = object_mask(data, object_id, model.image, numbers)
        mesh = mesh.coloured(network_inputs.image, network_inputs.camera, foreground(network_inputs.image) if mask is None else mask)
    return replace(prediction, closed=mesh)


def _write(out: Path, prediction: Prediction, surface: Surface) -> list[Path]:
    """Write a prediction to one file, or two beside each other."""
    to_metres = np.eye(4)
    to_metres[:3, :3] = prediction.metres_per_unit * turn_to_z(np.array(prediction.up))
    if (mesh := prediction.closed) is not None:
        write_closed(out, mesh.vertices, mesh.faces, mesh.colors, mesh.seen, to_metres)
        return [out]
    if prediction.reconstruction.is_whole:  # joined already
        surface = "charts"
    beside = out.with_name(f"{out.stem}-joined{out.suffix}")
    files = {"charts": {out: write_charts}, "joined": {out: write_joined}}.get(surface, {out: write_charts, beside: write_joined})
    for path, write in files.items():
        write(path, prediction.reconstruction, to_metres)
    return list(files)
