"""Train the network of one sensor from its file alone: random presses in memory, and no dataset."""

import tempfile
from pathlib import Path
from typing import Any

from pipeline.kernels.touch.sensor import Sensor, resample_longer_side
from pipeline.models.touch_model import LocalTouchModel, save_touch_model
from stages.train_touch.learner import train_local_network
from stages.train_touch.presses import random_presses
from stages.train_touch.stage import TouchTrainingSettings

PIXELS = 160
"""Pixels along the longer side of the network's input, as in `simulate-presses`."""
PRESSES, WATCHED = 1200, 16
"""Presses to train on, and to validate on."""
STEPS = 1200
"""Training steps, for any number of presses."""
GEL = (0.6, 1.5)
"""Least and greatest factor of the gel's thickness per press: photographs of balls do not determine it better. Much thinner gels touch the
object where thicker ones only sink beside it, and contact would become ambiguous."""


def train_sensor_network(
    sensor: Sensor,
    *,
    seed: int = 0,  # of presses and training
    presses: int = PRESSES,  # to learn from
    settings: TouchTrainingSettings | None = None,  # by default those of `train-touch`, for `STEPS` steps
) -> tuple[LocalTouchModel, dict[str, Any]]:  # and facts about the training
    """Train a local network to read a sensor's photographs."""
    if settings is None:
        settings = TouchTrainingSettings()
        settings = settings.model_copy(update={"epochs": max(1, round(STEPS * settings.batch_size / presses))})
    network_sensor = resample_longer_side(sensor, PIXELS)
    training, watched = (
        random_presses(network_sensor, count, press_seed, gel=GEL) for count, press_seed in ((presses, 2 * seed), (WATCHED, 2 * seed + 1))
    )
    with tempfile.TemporaryDirectory() as folder:
        network, facts = train_local_network(training, watched, settings, folder=Path(folder), seed=seed)
    return LocalTouchModel(network, training.sensor, training.untouched), facts


def save_sensor_network(model: LocalTouchModel, folder: Path) -> None:
    """Write a network into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    save_touch_model(folder, model.network, sensor=model.sensor, untouched=model.untouched)
