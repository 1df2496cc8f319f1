"""Train the network of one sensor from its file alone: random presses in memory, and no dataset."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.kernels.touch.depth_maps import press_gel, scaled_gel
from pipeline.kernels.touch.press_shapes import random_press
from pipeline.kernels.touch.sensor import Sensor, resample_longer_side
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.models.touch_model import LocalTouchModel, save_touch_model
from pipeline.rng import numpy_rng
from stages.train_touch import Presses, SimulatedPress, TouchTrainingSettings, train_local_network

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
        random_presses(network_sensor, count, press_seed) for count, press_seed in ((presses, 2 * seed), (WATCHED, 2 * seed + 1))
    )
    with tempfile.TemporaryDirectory() as folder:
        network, facts = train_local_network(training, watched, settings, folder=Path(folder), seed=seed)
    return LocalTouchModel(network, training.sensor, training.untouched), facts


def random_presses(
    sensor: Sensor,  # with as many pixels as the images shall have
    count: int,
    seed: int,  # of all draws
    gel: tuple[float, float] = GEL,  # least and greatest factor of gel thickness or membrane width, drawn per press
) -> Presses:
    """Press random shapes into a sensor; they stay in memory."""
    presses = []
    for number in range(count):
        rng = numpy_rng(seed, "random-presses", number)
        press = random_press(sensor, rng)
        varied = scaled_gel(sensor, rng.uniform(*gel))
        state = press_gel(press.depth, varied)
        presses.append(SimulatedPress(render_gel(state.indentation, varied, rng), state.indentation.astype(np.float32), state.contact))
    return Presses(sensor, untouched_image(sensor), [f"random press {number}" for number in range(count)], presses.__getitem__)


def save_sensor_network(model: LocalTouchModel, folder: Path) -> None:
    """Write a network into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    save_touch_model(folder, model.network, sensor=model.sensor, untouched=model.untouched)
