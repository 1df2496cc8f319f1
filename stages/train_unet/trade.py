"""The trade-off of `train-unet`: the error of predicted depths of test objects against the time of training."""

from pathlib import Path

import numpy as np

from pipeline.engine.trade import Trade
from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.models.touch_model import load_touch_model
from pipeline.store.directory import DataDirectory
from stages.train_unet.learner import load_touches


def depth_errors(data: Path, reference: Path) -> dict[str, float]:
    """Compare predicted depths with the true ones where the sensors of test objects touch: RMS by object, um."""
    touches = load_touches(data, "test")
    model = load_touch_model(DataDirectory(data).verified_folder("models/unet"), "cpu")
    tactile_images, depth = (tensor.numpy() for tensor in touches.read(range(len(touches))))
    contact = in_gel(depth, touches.sensor)
    squares = np.where(contact, (model.maps(tactile_images)[0] - depth).astype(np.float64), 0.0) ** 2
    rows_by_object = {touches.rows.object_ids[number]: touches.where[:, 0] == number for number in np.unique(touches.where[:, 0])}
    return {name: 1e6 * float(np.sqrt(squares[rows].sum() / contact[rows].sum())) for name, rows in rows_by_object.items()}


TRADE = Trade(
    metric="depth predicted for test objects, RMS",
    unit="um",
    candidates=({"epochs": 5}, {"epochs": 20}, {"width": 4}, {"width": 16, "epochs": 20}),
    errors=depth_errors,
)
