"""The trained network whose weights a training begins with."""

from pathlib import Path
from typing import Any

from torch import nn

from pipeline.errors import StageError
from pipeline.models.families import trained_folder, trained_models
from pipeline.models.reconstruction import Reconstructor
from pipeline.models.shipped_weights import models_place
from pipeline.store.directory import DataDirectory
from pipeline.store.record import FolderRecord

LEARNED_BEFORE = "learned_before"
"""Name of a training's fact: what its pretrained network had learned from."""
OF_MESHES = ("spacing", "touch_reach")
"""Entries of a network's description that only decide how its predictions are meshed; its weights do not depend on them."""
OTHER_STAGES = {"side": "fit-charts"}
"""Stages that set entries of a network's description, by entry; its training sets the others."""


def pretrained_folder(models: str, network: str) -> Path:
    """Find the folder of a trained network by a training's setting `pretrained`; errors as `trained_folder`."""
    return trained_folder(models_place(models), network)


def learned_before(models: str, network: str) -> list[dict[str, Any]]:
    """List the training data of a trained network, as `learned_from`."""
    folder = models_place(models)
    return learned_from(DataDirectory(trained_models(folder)[network]).folder(network))


def learned_from(record: FolderRecord) -> list[dict[str, Any]]:
    """List the training data of a record's network, also from before its training: manifest and items of each training."""
    manifest = record.options.get("--manifest", record.manifest)
    return [*record.facts.get(LEARNED_BEFORE, []), {"manifest": manifest, "items": record.facts["items"]}]


def give_weights(network: nn.Module, pretrained: Reconstructor, stage: str) -> None:
    """Give a network the weights of a trained one; raise a `StageError` that names the settings of the training if it has other sizes."""
    config: Any = network.config
    settings = [
        f"{OTHER_STAGES.get(name, stage)}.{name}={value}"
        for name, value in pretrained.config
        if name not in OF_MESHES and value != getattr(config, name)
    ]
    if settings:
        raise StageError(f"the network in `pretrained` has other sizes; to begin with it, set {' '.join(settings)}")
    network.load_state_dict(pretrained.network.state_dict())
