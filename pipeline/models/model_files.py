"""A trained network on disk: weights as safetensors (no pickles), and a description of the network as JSON."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import torch
from pydantic import BaseModel, ValidationError
from safetensors.torch import load_file, save
from torch import Tensor, nn

from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.formats.file_content import POINTER_REMEDY, is_pointer_file, read_file, regular_stat, without_mark

WEIGHTS, DESCRIPTION = "model.safetensors", "model.json"
MAX_BYTES = 2**20  # largest size of a description

D = TypeVar("D", bound=BaseModel)
N = TypeVar("N", bound=nn.Module)


def save_model(
    folder: Path,  # exists
    module: nn.Module,  # its parameters and buffers are written as safetensors
    description: BaseModel,  # its sizes, sensor, …, written as JSON
) -> None:
    """Write a trained network into a folder."""
    weights = {name: value.detach().cpu().contiguous() for name, value in module.state_dict().items()}
    (folder / WEIGHTS).write_bytes(save(weights))  # its errors name the disk, unlike those of `save_file`
    (folder / DESCRIPTION).write_text(json.dumps(description.model_dump(mode="json"), indent=2, sort_keys=True, allow_nan=False))


def read_description(folder: Path, kind: type[D]) -> D:
    """Read the description that `save_model` wrote; raise a `StoreError` if it is missing or an entry invalid."""
    _refuse_pointer(folder / DESCRIPTION)
    try:
        return kind.model_validate_json(without_mark(folder / DESCRIPTION, read_file(folder / DESCRIPTION, MAX_BYTES)))
    except ValidationError as error:
        raise unusable(folder, f"{DESCRIPTION}: {invalid_entries(error)}") from error
    except InvalidInput as error:
        raise unusable(folder, error) from error


def read_weights(folder: Path) -> dict[str, Tensor]:
    """Read the weights that `save_model` wrote; raise a `StoreError` if they cannot be read."""
    _refuse_pointer(folder / WEIGHTS)
    try:
        regular_stat(folder / WEIGHTS)
        return load_file(folder / WEIGHTS)
    except Exception as error:  # safetensors raises whatever its parsing trips over
        raise unusable(folder, f"{WEIGHTS}: {error}") from error


def load_network(
    folder: Path,  # written by `save_model`
    make: Callable[[], N],  # makes the network, with any weights
    device: torch.device | str,
) -> N:
    """Load a network for evaluation; memory is allocated only if its weights fit, else a `StoreError` is raised."""
    weights = read_weights(folder)
    with torch.device("meta"):  # shapes without memory
        network = make()
    expected, stored = ({name: tuple(value.shape) for name, value in state.items()} for state in (network.state_dict(), weights))
    if differing := sorted(name for name in expected.keys() | stored.keys() if expected.get(name) != stored.get(name)):
        name = differing[0]
        raise unusable(
            folder,
            f"{len(differing)} arrays of {WEIGHTS} differ from {DESCRIPTION}, {name} first: "
            f"{stored.get(name, 'missing')}, not {expected.get(name, 'there')}",
        )
    for name, value in network.state_dict().items():  # in the network's types and memory layouts
        weights[name] = torch.empty_strided(value.shape, value.stride(), dtype=value.dtype, device=device).copy_(weights[name])
    network.load_state_dict(weights, assign=True)
    return network.eval()


def _refuse_pointer(path: Path) -> None:
    if is_pointer_file(path):
        raise StoreError(f"{path} is {POINTER_REMEDY}")


def unusable(folder: Path, why: object) -> StoreError:
    """Make the error for a folder whose network cannot be used."""
    return StoreError(f"{folder} holds no trained model that can be used ({why}); delete it, and run the stage that trains it")
