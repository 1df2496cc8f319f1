"""The families of networks that reconstruct: one entry adds a family to models, evaluation, prediction and reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import StageError, closest_name
from pipeline.kernels.networks.network_configurations import (
    CONFIGURATIONS,
    IMPLICIT_CONFIGURATIONS,
    INPUT_CHOICES,
    SINGLE_IMAGE,
    NetworkInputs,
)
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, list_folder

if TYPE_CHECKING:
    import torch

    from pipeline.models.reconstruction import Reconstructor, Trained

FAMILIES: Mapping[str, Mapping[str, NetworkInputs]] = {
    "gcn": CONFIGURATIONS,
    "implicit": IMPLICIT_CONFIGURATIONS,
    "": {"single-image": SINGLE_IMAGE},
}
"""The networks of each family, by the folder of its models below `models`; a family of one network needs none."""


@dataclass(frozen=True)
class NetworkRow:
    """A network with the inputs that it is given: a row of the tables of results."""

    network: str  # its name
    family: str
    inputs: NetworkInputs


ROWS: dict[str, NetworkRow] = {
    name: NetworkRow(name, family, inputs) for family, networks in FAMILIES.items() for name, inputs in networks.items()
}
ROWS |= {
    f"{name}-{way}": NetworkRow(name, row.family, row.inputs.restricted_to(inputs))
    for name, row in ROWS.items()
    if row.inputs.image == "any"
    for way, inputs in INPUT_CHOICES.items()
}
"""The networks by name. One that takes any inputs also has a row for each combination of them: `implicit-any-touch` is the network
`implicit-any` with touches alone."""


def rows_of(network: str) -> list[str]:
    """Name the rows of a network's results: its own, or those of each combination of inputs."""
    return [name for name, row in ROWS.items() if row.network == network and name != network] or [network]


def row_of(trained: Trained) -> str:
    """Name the row of a network with the inputs that it takes; a network that takes no choice of inputs is its own row."""
    takes = (trained.configuration, trained.network.image, trained.network.touch)
    rows = [name for name, row in ROWS.items() if (row.network, row.inputs.image, row.inputs.touch) == takes]
    return (rows or [trained.configuration])[0]


def reconstructor_type(configuration: str) -> type[Reconstructor]:
    """Load what makes and uses a configuration's network; it needs torch, which the names of networks do not."""
    from pipeline.models.reconstruction import DeformationReconstructor, ImplicitReconstructor

    types: Mapping[str, type[Reconstructor]] = {
        "gcn": DeformationReconstructor,
        "implicit": ImplicitReconstructor,
        "": DeformationReconstructor,
    }
    return types[ROWS[configuration].family]


def model_name(configuration: str, training_seed: int = 0) -> str:
    """Name the folder of a configuration's model below a data directory; further trainings are below `models/seed-1` and so on."""
    row = ROWS[configuration]
    folders = ("models", f"seed-{training_seed}" if training_seed else "", row.family, row.network)
    return "/".join(filter(None, folders))


def model_record(configuration: str, training_seed: int = 0) -> str:
    """Return the path of the record of a configuration's model, below a folder of models."""
    return f"{model_name(configuration, training_seed).removeprefix('models/')}.json"


def load_reconstructor(
    configuration: str,  # a key of `ROWS`
    folder: Path,  # written by its training
    device: torch.device | str = "cpu",
) -> Reconstructor:
    """Load the trained network of a configuration; raise a `StoreError` if the folder does not hold it."""
    return load_rows({configuration: folder}, device)[configuration]


def load_rows(folders: Mapping[str, Path], device: torch.device | str = "cpu") -> dict[str, Reconstructor]:
    """Load the networks of configurations, by name, as `load_reconstructor`; one that several rows share is read once."""
    loaded: dict[Path, Reconstructor] = {}
    for name, folder in folders.items():
        if folder not in loaded:
            loaded[folder] = reconstructor_type(name)(folder, device)
    return {name: loaded[folder].restricted_to(ROWS[name].inputs) for name, folder in folders.items()}


def trained_models(models: Location, training_seed: int = 0) -> dict[str, Location]:
    """Find the trained networks: by configuration, the folder below `models` that holds its record."""
    folders = {name: (models / model_record(name, training_seed)).parent for name in ROWS}
    records = {folder: set(list_folder(folder)) for folder in set(folders.values())}
    return {name: folder for name, folder in folders.items() if f"{ROWS[name].network}.json" in records[folder]}


def trained_folder(
    models: Location,  # such as DATA/models
    configuration: str,  # a key of `ROWS`
    training_seed: int = 0,
) -> Path:
    """Find the folder of a configuration's trained network, or make a local copy if it is in object storage."""
    trained = trained_models(models, training_seed)
    if configuration not in trained:
        if not list_folder(models):
            raise StageError(f"{models} does not exist, or is empty; name a folder of models, such as DATA/models")
        networks = sorted({ROWS[name].network for name in trained})
        available = f"its models are {', '.join(networks)}" if networks else "there are none at all"
        guess = closest_name(configuration, trained) or ("models" in list_folder(models) and models / "models")
        train = f"{'choose one of these, or ' if networks else ''}train it with train-gcn, train-implicit, …"
        advice = f"did you mean {guess}?" if guess else train
        seed = f"seed-{training_seed}" if training_seed else ""
        raise StageError(f"{models / seed} has no model {configuration}: {available}; {advice}")
    return DataDirectory(trained[configuration]).verified_folder(ROWS[configuration].network)
