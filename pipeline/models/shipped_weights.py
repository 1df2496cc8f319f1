"""Pretrained networks of the package: models in the layout of a training, and one per calibrated sensor; each has a card."""

from pathlib import Path
from typing import Annotated

import yaml
from pydantic import Field, ValidationError

import pipeline
from pipeline.entries import Entries
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.formats.file_content import read_file
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL
from pipeline.models.families import ROWS, model_record, reconstructor_type, trained_folder, trained_models
from pipeline.models.model_files import DESCRIPTION
from pipeline.store.storage import Location, as_location

SHIPPED = Path(pipeline.__file__).parent / "assets" / "weights"
"""Laid out as DATA/models. `make weights` and `make gel-weights` fill it; a version without weights has no such folder."""
SENSORS = "sensors"
"""Folder below `SHIPPED` of the networks that read photographs, by their sensor's name. `make sensor-weights` fills it."""
DEFAULT = "implicit-any"  # the network that reconstructs objects of unknown size, if none is named
CARD = "{}.card.yaml"
MAX_BYTES = 2**16  # largest size of a card
UNLIKE = 1.25  # ratio of sizes beyond which objects, and gels beside them, are unlike those of a training or measurement


class TrainedOn(Entries):
    """One source of the objects that a network learned from."""

    source: str
    licence: str


class Error(Entries):
    """Chamfer distances × 9000 with one grasp over the test objects of a class, in objects of 0.5 m."""

    objects: int = Field(ge=1)
    mean: float = Field(ge=0)
    median: float = Field(ge=0)
    mm: float | None = Field(default=None, ge=0)  # mean distance, in the objects' own size
    diagonals: tuple[float, float] = (DIAGONAL, DIAGONAL)  # of the smallest and largest of them, m


class ModelCard(Entries):
    """The card of a pretrained network."""

    network: str  # its configuration
    # objects per manifest, also of a network that its training began with
    learned_from: dict[str, Annotated[int, Field(ge=1)]] = Field(min_length=1)
    trained_on: tuple[TrainedOn, ...] = Field(min_length=1)  # the sources of these, with their licences
    commit: str  # of the code that trained it
    command: str
    # of other objects, by row of the tables (inputs) and class; `all` is every object, `0.1 to 0.2 m` those of such diagonals
    errors: dict[str, dict[str, Error]]
    not_for: str  # uses that it is not meant for

    def error_of(self, row: str, diagonal: float | None) -> Error | None:
        """Find the error of a row on objects of a size, m, or on all; None if none of such a size were measured."""
        errors = self.errors.get(row, {})
        if diagonal is None:
            return errors.get("all")
        of_sizes = [error for name, error in errors.items() if name.endswith(" m")]
        measured = [*of_sizes, *filter(None, [errors.get("all")])]
        like = min(measured, key=lambda error: size_ratio(diagonal, error.diagonals), default=None)
        return like if like and is_like(diagonal, like.diagonals) else None


def is_like(diagonal: float, sizes: tuple[float, float]) -> bool:
    """Check whether an object of a diagonal is about as large as others of a range of diagonals."""
    return size_ratio(diagonal, sizes) <= UNLIKE


def size_ratio(diagonal: float, sizes: tuple[float, float]) -> float:
    """Compute how many times an object is larger or smaller than those of a range of diagonals; 1 within it."""
    return max(sizes[0] / diagonal, diagonal / sizes[1], 1.0)


def shipped_models() -> Path:
    """Find the folder of the pretrained networks; raise a `StageError` if this version has none."""
    if not trained_models(SHIPPED):
        raise StageError(
            "no network ships with this version of vt-pipeline: name a folder of models with --models, or a data directory with --data"
        )
    return SHIPPED


def shipped_network(diagonal: float | None = None) -> str:
    """Choose the pretrained network whose objects are nearest in size to one of a diagonal, m; `DEFAULT` if that is not known."""
    if diagonal is None:
        return DEFAULT
    models = shipped_models()
    networks = dict.fromkeys(ROWS[name].network for name in trained_models(models))
    sizes = {name: reconstructor_type(name).described(trained_folder(models, name)).sizes for name in networks}
    return min(networks, key=lambda name: size_ratio(diagonal, sizes[name]))


def models_location(name: str) -> Location:
    """Find a folder of models by its name on a command line or in a setting, `shipped` or a path; errors as `shipped_models`."""
    return shipped_models() if name == "shipped" else as_location(name)


def card_path(models: Path, configuration: str) -> Path:
    """Return the path of a network's card, below a folder of models."""
    return (models / model_record(configuration)).with_name(CARD.format(ROWS[configuration].network))


def shipped_sensor_network(sensor: str, weights: Path = SHIPPED) -> Path | None:
    """Find the folder of the pretrained network for a sensor's photographs; None if there is none."""
    folder = weights / SENSORS / sensor
    return folder if (folder / DESCRIPTION).is_file() else None


def read_card(configuration: str, models: Path | None = None) -> ModelCard:
    """Read the card of a pretrained network; raise a `StoreError` if there is none, or it cannot be used."""
    path = card_path(models or SHIPPED, configuration)
    try:
        return ModelCard.model_validate(yaml.safe_load(read_file(path, MAX_BYTES)))
    except ValidationError as error:
        raise StoreError(f"{path}: {invalid_entries(error)}; restore it, or install vt-pipeline again") from error
    except (InvalidInput, OSError, yaml.YAMLError) as error:
        raise StoreError(f"{path} cannot be read as a card ({error}); restore it, or install vt-pipeline again") from error
