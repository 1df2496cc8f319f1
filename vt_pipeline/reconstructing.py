"""Reconstructions: from what a robot saw and felt to the object's surface, by a trained network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.reconstruct.observation_file import RobotObservation

if TYPE_CHECKING:
    from pipeline.reconstruct.predict import Prediction


def load_observation(path: str | Path) -> RobotObservation:
    """Read an observation file with the photographs that it names; an `InvalidInput` lists all its faults."""
    from pipeline.reconstruct.observation_checks import check  # imports torch, which `touch` does not need

    return check(Path(path)).observation


def reconstruct(
    observation: RobotObservation | str | Path,
    models: str | Path | None = None,
    configuration: str | None = None,
    *,
    resolution: int = 128,
    training_seed: int = 0,
    accelerator: str = "auto",
    seed: int = 0,
) -> Prediction:
    """Reconstruct the surface of an object that a robot saw or felt.

    Parameters
    ----------
    observation
        From `load_observation`, or a `RobotObservation` of arrays, or the path of an observation file.
    models
        Folder of trained models, DATA/models, or `shipped`: by default, the pretrained networks.
    configuration
        Which of them; by default `occluded-touch`, of the pretrained ones `implicit-any`, which accepts any subset of inputs.
    resolution
        Edges of the closed mesh along the longest side of its box, 64 to 400.
    training_seed
        Which training of the model, where there are several.
    accelerator
        Where the networks run: "cpu", "cuda", or "auto".
    seed
        Of the chart fitting.

    Returns
    -------
    `closed`, one mesh with colours, and `reconstruction`, the network's surface, both in the observation's frame and unit; and `remarks`.

    Raises
    ------
    InvalidInput
        The observation has faults, of which the message lists all; or the resolution is beyond its limits.
    StageError, StoreError
        There is no such model, or it cannot be used.
    """
    from pipeline.models.shipped_weights import models_location
    from pipeline.reconstruct import predict

    folder = None if models is None else models_location(str(models))
    options = predict.PredictOptions(folder, configuration, training_seed, accelerator, seed, resolution)
    if not isinstance(observation, str | Path | RobotObservation):
        raise TypeError(f"observation is a RobotObservation or the path of an observation file; this is {type(observation).__name__}")
    return predict.reconstruct(Path(observation) if isinstance(observation, str) else observation, options)
