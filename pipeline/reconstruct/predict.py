"""Predict an object's surface from stored grasps or a robot's observation, and write it as a mesh file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter, errors, pluralise
from pipeline.errors import InvalidInput, StageError
from pipeline.formats.description_file import read_yaml
from pipeline.kernels.geometry.closed_surface import RESOLUTION
from pipeline.kernels.networks.network_configurations import INPUT_CHOICES
from pipeline.kernels.vision.view_transfer import foreground
from pipeline.models.device import device_of
from pipeline.models.families import load_reconstructor, model_name, trained_folder, trained_models
from pipeline.models.foreign_data import as_learned, range_text, size_remarks
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction, Trained, close_reconstruction
from pipeline.models.shipped_weights import SHIPPED, models_location, shipped_models, shipped_network
from pipeline.reconstruct.mesh_files import ClosedMesh, check_output, write_charts, write_closed
from pipeline.reconstruct.network_error import error_note
from pipeline.reconstruct.object_location import turn_to_z
from pipeline.reconstruct.observation_checks import check, find_box
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import Placement, describe_object, place_observation
from pipeline.reconstruct.observation_reader import ObservationReader, object_mask, open_object
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from pipeline.store.validate import check_origins

Surface = Literal["charts", "joined", "both", "closed"]
ALIKE = 0.85, 1.25  # diagonals of a surface, over the object's, without a warning: beyond, the error is half as large again
RESOLUTIONS = 64, 400  # fewest and most edges of a closed mesh


@dataclass(frozen=True)
class StoredGrasps:
    """Grasps of an object in a data directory, or its rendering from a viewpoint."""

    data: Location
    object_id: str
    grasps: Sequence[int] | None = None  # by default grasp 0; the occluded image is the first one's
    view: int = 0
    inputs: str = "occluded-touch"  # a key of `INPUT_CHOICES`; of a network that takes any

    def chosen(self, reader: ObservationReader) -> Sequence[int]:
        """Choose the grasps, or the one viewpoint, that a network is given."""
        name = reader.model.trained.configuration
        if reader.model.config.image == "rendering":
            if self.grasps:
                raise StageError(f"model {name} takes a rendering: use --view, not --grasp {self.grasps[0]}")
            return [self.view]
        if self.view:
            raise StageError(f"model {name} takes grasps: use --grasp, not --view {self.view}")
        return [0] if self.grasps is None else self.grasps


Observed = StoredGrasps | RobotObservation | Path | None


@dataclass(frozen=True)
class PredictOptions:
    """Which network predicts, and how."""

    models: Location | str | None = None  # folder of models, or `shipped`; by default the data directory's if it holds some, else `shipped`
    configuration: str | None = None  # the network; by default `occluded-touch`, of the pretrained ones that for the object's size
    training_seed: int = 0  # of which training the network is
    accelerator: str = "auto"  # where networks run: "cpu", "cuda", or "auto"
    seed: int = 0  # of the chart fitting
    resolution: int = RESOLUTION  # edges of the closed mesh along the longest side of its box

    def __post_init__(self) -> None:
        if not isinstance(self.resolution, int | np.integer) or not RESOLUTIONS[0] <= self.resolution <= RESOLUTIONS[1]:
            raise InvalidInput(f"resolution is {self.resolution!r}; it must be a whole number, {RESOLUTIONS[0]} to {RESOLUTIONS[1]}")
        for name in ("training_seed", "seed"):
            if not isinstance(value := getattr(self, name), int | np.integer) or value < 0:
                raise TypeError(f"{name} is a whole number, 0 or more; this is {value!r}")

    def network(self, source: Observed = None) -> tuple[Location, str]:
        """Choose the folder of models and the network; of pretrained ones, that which has learned from objects as large as the source's."""
        data = source.data if isinstance(source, StoredGrasps) else None
        models = models_location(self.models) if isinstance(self.models, str) else self.models
        if models is None and data is not None:
            trained = trained_models(data / "models", self.training_seed)
            models = data / "models" if trained or self.training_seed or not trained_models(SHIPPED) else None
        if models is None and self.training_seed:
            raise StageError(f"a pretrained network has one training; name models of training seed {self.training_seed}, or omit the seed")
        folder = shipped_models() if models is None else models
        if self.configuration or folder != SHIPPED:
            return folder, self.configuration or "occluded-touch"
        return folder, shipped_network(_diagonal_of(source))

    def reader(self, source: Observed = None) -> ObservationReader:
        """Load the network for a source, and the reader of its inputs."""
        models, configuration = self.network(source)
        device = device_of(self.accelerator)
        model = load_reconstructor(configuration, trained_folder(models, configuration, self.training_seed), device)
        return ObservationReader(model, models, device, self.seed, self.training_seed)


@dataclass(frozen=True)
class Prediction:
    """A predicted surface, and the files that hold it."""

    reconstruction: Reconstruction  # in the world, m, or in the observation's frame and unit
    touched: NDArray[np.bool_]  # (T,), of the given sensors: whether their charts are part of it
    visible: int = 0  # how many patches of the visible surface were given as touched
    closed: ClosedMesh | None = None  # if it was asked for
    to_metres: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))  # (4, 4) from its frame to metres with z up
    remarks: list[str] = field(default_factory=list)  # what was assumed, what differs from the training, and the network's error
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
    out: Path,  # .obj, .ply or .glb
    source: Observed = None,  # what the network is given, or the file of an observation; None for networks without inputs
    options: PredictOptions | None = None,
    surface: Surface = "both",
) -> Prediction:
    """Reconstruct an object from a data directory or from a robot's observation, and write its surface.

    With `surface` "both" the charts go to `out`, and the joined surface beside it under the same name with -joined; an implicit network's
    one mesh goes there alone. "closed" is one closed, smooth mesh, of an object of half a metre within 0.5 mm of the touch charts, coloured
    where the image shows it. Lengths and frame are the world's or the observation's; GLB is in metres, and y up.
    """
    check_output(out)
    if isinstance(source, Path):
        read_yaml(source, "observation file")  # before networks are read, which takes longer
    options = options or PredictOptions()
    with Meter(errors, "predict", 3, "steps", after=1.0) as meter:
        reader = options.reader(source)
        meter.advance("the network is read")
        prediction = _predicted(options, reader, source, surface)
        meter.advance("the surface is made")
        prediction = replace(prediction, files=_write(out, prediction, surface))
        meter.advance("and written")
    return prediction


def reconstruct(observation: Path | RobotObservation, options: PredictOptions | None = None) -> Prediction:
    """Reconstruct an object from a robot's observation, with a closed mesh, and write nothing."""
    options = options or PredictOptions()
    return _predicted(options, options.reader(observation), observation, "closed")


@dataclass(frozen=True)
class _Given:
    """What a network is given of an object."""

    reader: ObservationReader  # of the network, restricted to these inputs
    inputs: Observation
    photograph: tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_]] | None = None  # that colours a closed mesh
    remarks: Sequence[str] = ()
    placed: Placement | None = None  # of a robot's observation
    diagonal: float | None = None  # of the object, m, if it is known, or guessed


def _diagonal_of(source: Observed) -> float | None:
    """Find how large an object is, m, before its network is chosen; None if that is not known."""
    if isinstance(source, StoredGrasps):
        return open_object(source.data, ["points"], source.object_id, ()).diagonal(source.object_id)
    box = None if source is None else find_box(source)
    return None if box is None else box.diagonal


def _choice_remark(trained: Trained, diagonal: float | None) -> str:
    """Say which pretrained network was chosen, and why."""
    unknown = "" if diagonal is not None else "; taken as the object's size is not known: state object.diagonal"
    return f"{trained.configuration}: trained with objects of {range_text(trained.sizes, '.2g')} m{unknown}"


def _predicted(options: PredictOptions, reader: ObservationReader, source: Observed, surface: Surface) -> Prediction:
    if isinstance(source, StoredGrasps):
        given = _of_object(reader, source)
    else:
        given = _of_nothing(reader) if source is None else _of_robot(reader, source)
    inputs, placed, closed = given.inputs, given.placed, None
    reconstruction = given.reader.model.reconstruct([inputs])[0]
    if surface == "closed":
        vertices, faces = close_reconstruction(reconstruction, options.resolution, inputs)
        closed = ClosedMesh.grey(placed.returned(vertices) if placed else vertices, faces)
        if given.photograph is not None:
            closed = closed.coloured(*given.photograph)
    is_chosen = options.configuration is None and reader.models == SHIPPED
    remarks = [*([_choice_remark(reader.model.trained, given.diagonal)] if is_chosen else []), *given.remarks]
    if reconstruction.is_guess:
        remarks.append("warning: the network finds no point inside the object; the surface is a speck around the likeliest one")
    elif given.diagonal is not None and not (placed and placed.checked.box.by_mask):
        remarks += size_remark(reconstruction, inputs, given.diagonal, 2 * reader.model.config.radius)
    remarks.append(error_note(given.reader, given.diagonal))
    if placed is None:
        return Prediction(reconstruction, inputs.touched, closed=closed, remarks=remarks)
    observed = placed.checked.observation
    touched, visible = np.split(inputs.touched, [len(observed.touches)])
    returned = replace(reconstruction, vertices=placed.returned(reconstruction.vertices))
    to_metres = np.eye(4)
    to_metres[:3, :3] = observed.metres_per_unit * turn_to_z(np.array(observed.up))
    return Prediction(returned, touched, len(visible), closed, to_metres, remarks)


def size_remark(
    made: Reconstruction,
    inputs: Observation,
    diagonal: float,  # m, of the object
    learned: float,  # m, which every object has where the network sees it
) -> Iterator[str]:
    """Warn if a surface is much larger or smaller than its object."""
    share = inputs.scale * float(np.linalg.norm(np.ptp(made.vertices, axis=0))) / learned
    if not ALIKE[0] <= share <= ALIKE[1]:
        yield f"warning: the surface's diagonal is {share * diagonal:.2g} m, the object's {diagonal:.2g} m: much of it is a guess"


def _of_nothing(reader: ObservationReader) -> _Given:
    """Give a network without inputs nothing: it reconstructs what it takes any object to be."""
    model = reader.model
    if model.config.image or model.config.touch:
        needed = [name for name, is_used in (("an image", model.config.image), ("touches", model.config.touch)) if is_used]
        inputs = (" or " if model.config.image == "any" else " and ").join(needed)
        raise StageError(f"model {model.trained.configuration} needs {inputs}: give an observation, or a data directory and an object")
    return _Given(reader, Observation(None, scale=2 * model.config.radius / reader.target.size))


def _of_robot(reader: ObservationReader, source: RobotObservation | Path) -> _Given:
    """Check a robot's observation, and place it in the world of the network."""
    placed = place_observation(check(source, reader.target))
    observed, reader = placed.checked.observation, reader.restricted_to(placed.checked.inputs)
    inputs, photograph = reader.of_robot(placed), None
    stated = zip(observed.touches, inputs.touched, strict=False)  # none for networks without touch
    unfelt = {observed.name_of(n): touch.touched for n, (touch, is_touched) in enumerate(stated) if touch.touched and not is_touched}
    unseen = [name for name, told in unfelt.items() if told is True]
    free = [name for name in unfelt if name not in unseen]
    remarks = [describe_object(observed, placed.checked.box), *placed.remarks]
    if unseen:
        remarks.append(f"warning: {', '.join(unseen)}: touched: true, but no contact is seen, so no touch is given")
    if free:
        remarks.append(f"{', '.join(free)}: no contact is seen, so the network is given a free gel")
    if (view := observed.view) is not None:
        matrix = view.matrix * [*(3 * [observed.metres_per_unit]), 1.0]  # of points in the observation's unit
        photograph = view.camera.image, matrix, view.camera.object_pixels
    return _Given(reader, inputs, photograph, remarks, placed, placed.checked.box.diagonal)


def _of_object(reader: ObservationReader, stored: StoredGrasps) -> _Given:
    """Read grasps of a data directory, or the rendering of a viewpoint."""
    numbers, name = stored.chosen(reader), reader.model.trained.configuration
    if reader.is_of(stored.data):
        check_origins(DataDirectory(stored.data), [model_name(name, reader.training_seed)])
    if reader.model.config.image == "any":
        reader = reader.restricted_to(INPUT_CHOICES[stored.inputs])
    model, inputs = reader.model, reader.of_object(stored.data, stored.object_id, numbers)
    photograph, remarks = None, list[str]()
    if inputs.image is not None and inputs.camera is not None:
        is_stored = model.config.image in ("occluded", "unoccluded")
        mask = object_mask(stored.data, stored.object_id, model.config.image, numbers) if is_stored else foreground(inputs.image)
        photograph = inputs.image, inputs.camera, mask
    diagonal = 2 * model.config.radius / inputs.scale
    if not reader.is_of(stored.data):
        inputs, further = as_learned(model.trained, inputs)
        remarks = [*size_remarks(model.trained, [diagonal], reader.sensors_in(stored.data), reader.target.sensor), *further]
    return _Given(reader, inputs, photograph, remarks, diagonal=diagonal)


def _write(out: Path, prediction: Prediction, surface: Surface) -> list[Path]:
    """Write a prediction to one file, or two beside each other."""
    if prediction.closed is not None:
        write_closed(out, prediction.closed, prediction.to_metres)
        return [out]
    beside = out.with_name(f"{out.stem}-joined{out.suffix}")
    joined = {"joined": {out: True}, "both": {out: False, beside: True}}.get(surface, {out: False})
    if prediction.reconstruction.is_whole:  # joined already
        joined = {out: False}
    for path, is_joined in joined.items():
        write_charts(path, prediction.reconstruction, prediction.to_metres, joined=is_joined)
    return list(joined)
