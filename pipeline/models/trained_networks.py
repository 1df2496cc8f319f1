"""Networks that reconstruct, by name: where each is, and how it is loaded."""

from __future__ import annotations

from pathlib import Path

import torch

from pipeline.kernels.networks.implicit_configurations import IMPLICIT_CONFIGURATIONS
from pipeline.models.implicit_reconstruction import ImplicitReconstructor
from pipeline.models.reconstruction import Reconstructor

FAMILIES = ("gcn", "implicit")
"""Folders of models of a data directory, by what is in them: networks that deform charts, and implicit ones."""

SINGLE_IMAGE_MODEL = "single-image"
"""The model of the supplement's last experiment, which is of no family: it is given a rendering."""


def family_of(configuration: str) -> str:
    """Name the family of a configuration's network."""
    return "implicit" if configuration in IMPLICIT_CONFIGURATIONS else "gcn"


def model_name(configuration: str, training_seed: int = 0) -> str:
    """Name the folder of a configuration's model, below a data directory, which holds further trainings below `models/seed-1` and so on."""
    if configuration == SINGLE_IMAGE_MODEL:
        return f"models/{SINGLE_IMAGE_MODEL}"
    seed = f"seed-{training_seed}/" if training_seed else ""
    return f"models/{seed}{family_of(configuration)}/{configuration}"


def load_reconstructor(configuration: str, folder: Path, device: torch.device | str = "cpu") -> Reconstructor:
    """Load the network of a configuration that its training left in a folder; a `StoreError` where there is none."""
    return (ImplicitReconstructor if family_of(configuration) == "implicit" else Reconstructor)(folder, device)
