"""A trained network on disk: weights as safetensors (no pickles), and beside them, as JSON, what it takes to use them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from pipeline.errors import StoreError

WEIGHTS, DESCRIPTION = "model.safetensors", "model.json"


def save_model(folder: Path, module: nn.Module, description: Mapping[str, Any]) -> None:
    """Write a network's parameters and buffers, and its description (sizes, sensor, …, as JSON), into a folder."""
    save_file({name: value.detach().cpu().contiguous() for name, value in module.state_dict().items()}, folder / WEIGHTS)
    (folder / DESCRIPTION).write_text(json.dumps(description, indent=2, sort_keys=True, allow_nan=False))


def load_model(folder: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read the state dict and the description that `save_model` wrote; a `StoreError` where there is none that can be read."""
    try:
        return load_file(folder / WEIGHTS), json.loads((folder / DESCRIPTION).read_text())
    except (OSError, ValueError) as error:
        raise StoreError(f"{folder} holds no trained model ({error}); run the stage that trains it") from error
