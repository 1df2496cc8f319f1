"""The families of networks that reconstruct: one entry adds a family to models, evaluation, prediction and reports."""

from __future__ import annotations

from collections.abc import Mapping
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

EVERY_CONFIGURATION: Mapping[str, NetworkInputs] = {name: config for family in FAMILIES.values() for name, config in family.items()}
"""The networks of all families by name."""

ROWS: Mapping[str, tuple[str, NetworkInputs]] = {
    f"{name}-{way}": (name, config.restricted_to(inputs))
    for name, config in EVERY_CONFIGURATION.items()
    if config.image == "any"
    for way, inputs in INPUT_CHOICES.items()
}
"""Networks that take any inputs, with each combination of them: `implicit-any-touch` is the network `implicit-any` with touches alone."""

GRASP_CONFIGURATIONS = {name: config for name, config in EVERY_CONFIGURATION.items() if config.image != "rendering"}
"""The networks whose inputs are grasps of an object, by image or touch; the input of the others is a rendering."""


def network_of(configuration: str) -> str:
    """Name the network that a configuration uses: its own name, or that of the network that takes any inputs."""
    return ROWS[configuration][0] if configuration in ROWS else configuration


def inputs_of(configuration: str) -> NetworkInputs:
    """Look up the inputs of a configuration."""
    return ROWS[configuration][1] if configuration in ROWS else EVERY_CONFIGURATION[configuration]


def row_of(trained: Trained) -> str:
    """Name the row of a network with the inputs that it takes; a network that takes no choice of inputs is its own row."""
    takes = (trained.configuration, trained.network.image, trained.network.touch)
    return next((row for row, (name, inputs) in ROWS.items() if (name, inputs.image, inputs.touch) == takes), trained.configuration)


def family_of(configuration: str) -> str:
    """Name the family of a configuration's network; raise a `KeyError` for an unknown configuration."""
    configuration = network_of(configuration)
    families = {name: folder for folder, family in FAMILIES.items() for name in family}
    return families[configuration]


def reconstructor_type(configuration: str) -> type[Reconstructor]:
    """Load what makes and uses a configuration's network; it needs torch, which the names of networks do not."""
    from pipeline.models.deformation_reconstruction import DeformationReconstructor
    from pipeline.models.implicit_reconstruction import ImplicitReconstructor

    types: Mapping[str, type[Reconstructor]] = {
        "gcn": DeformationReconstructor,
        "implicit": ImplicitReconstructor,
        "": DeformationReconstructor,
    }
    return types[family_of(configuration)]


def model_name(configuration: str, training_seed: int = 0) -> str:
    """Name the folder of a configuration's model below a data directory; further trainings are below `models/seed-1` and so on."""
    folders = ("models", f"seed-{training_seed}" if training_seed else "", family_of(configuration), network_of(configuration))
    return "/".join(filter(None, folders))


def load_reconstructor(
    configuration: str,  # a key of `EVERY_CONFIGURATION` or `ROWS`
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
    return {name: loaded[folder].restricted_to(inputs_of(name)) if name in ROWS else loaded[folder] for name, folder in folders.items()}


def trained_models(models: Location, training_seed: int = 0) -> dict[str, Location]:
    """Find the trained networks: by configuration, the folder below `models` that holds its record."""
    names = (*EVERY_CONFIGURATION, *ROWS)
    folders = {name: (models / model_name(name, training_seed).removeprefix("models/")).parent for name in names}
    records = {folder: set(list_folder(folder)) for folder in set(folders.values())}
    return {name: folder for name, folder in folders.items() if f"{network_of(name)}.json" in records[folder]}


def trained_folder(
    models: Location,  # such as DATA/models
    configuration: str,  # a key of `EVERY_CONFIGURATION` or `ROWS`
    training_seed: int = 0,
) -> Path:
    """Find the folder of a configuration's trained network, or make a local copy if it is in object storage.

    Raise a `StageError` if there is none, a `StoreError` if a file of it is missing or was changed.
    """
    trained = trained_models(models, training_seed)
    if configuration not in trained:
        if not list_folder(models):
            raise StageError(f"{models} does not exist, or is empty; name a folder of models, such as DATA/models")
        networks = sorted({network_of(name) for name in trained})
        available = f"its models are {', '.join(networks)}" if networks else "there are none at all"
        guess = closest_name(configuration, trained) or ("models" in list_folder(models) and models / "models")
        train = f"{'choose one of these, or ' if networks else ''}train it with train-gcn, train-implicit, …"
        advice = f"did you mean {guess}?" if guess else train
        seed = f"seed-{training_seed}" if training_seed else ""
        raise StageError(f"{models / seed} has no model {configuration}: {available}; {advice}")
    return DataDirectory(trained[configuration]).verified_folder(network_of(configuration))
