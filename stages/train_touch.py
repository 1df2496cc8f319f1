"""`train-touch`: a local network learns to read depth in photographs, from simulated presses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from pipeline.config.settings import setting
from pipeline.dataset.object_rows import sensor_of
from pipeline.engine.stage import Cost, DatasetJob
from pipeline.kernels.touch.sensor import MM
from pipeline.rng import seeded_weights
from pipeline.store.directory import DataDirectory
from pipeline.training.learner import Learner
from pipeline.training.press_variation import VariedPresses, vary_change
from pipeline.training.presses import Presses, stored_presses
from pipeline.training.settings import Schedule
from pipeline.training.training_stage import Training
from schemas.base import Artifact
from schemas.presses import PRESSES
from schemas.touch import TOUCH

if TYPE_CHECKING:
    import torch
    from torch import Tensor, nn

    from pipeline.kernels.networks.local_network import LocalNetwork, LocalShape

NAME = "train-touch"
AT_CONTACT = 0.85  # share of the windows that lie about a contact; the others lie anywhere


class TouchTrainingSettings(VariedPresses):
    """How the local network that reads photographs is trained on simulated presses."""

    pretrained: Literal["shipped"] | None = setting(
        None, "`shipped` takes the pretrained network for the sensor of the dataset's touches as it is, and needs no presses"
    )
    learning_rate: float = setting(4e-3, "for a small network and a thousand steps", gt=0, le=100)
    schedule: Schedule = setting("cosine", "a training of fixed length ends with small steps")
    epochs: int = setting(
        11,
        "with 1,800 presses, 1,200 steps; the last is kept: the error on simulated presses does not tell when to stop for photographs",
        ge=1,
    )
    patience: Literal[None] = setting(None, "the last epoch is kept")
    width: int = setting(20, "features of the hidden layers: 5,000 parameters", ge=1, le=2**12)
    window: int = setting(64, "pixels per side of the part of a press that a step sees; it costs a sixth of whole images of 160", ge=16)


class Windows(NamedTuple):
    """Windows of some presses."""

    change: Tensor  # (B, 3, H, W) change of colours, levels
    position: Tensor  # (B, 2, H, W)
    depth: Tensor  # (B, H, W) mm, true
    contact: Tensor  # (B, H, W) bool, true


class PressLearner(Learner):
    """A local network with its presses."""

    keeps_last = True
    train: Presses
    valid: Presses

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Windows:
        """Read a varied window of each press."""
        return _stacked([self._window(self.train, item, generator) for item, generator in zip(items, generators, strict=True)])

    def _window(self, presses: Presses, item: int, generator: torch.Generator | None) -> Windows:
        """Read a varied window of a press, or without a generator all of it, as it is."""
        import torch

        from pipeline.kernels.networks.local_network import pixel_positions

        press, position = presses.read(item), pixel_positions(*presses.sensor.shape)[0]
        change = torch.from_numpy(press.image.astype(np.float32) - presses.untouched).permute(2, 0, 1)
        depth, contact = torch.from_numpy(MM * press.indentation), torch.from_numpy(press.contact.copy())
        if generator is None:
            return Windows(change, position, depth, contact)
        rows, cols = self._draw_window(press.contact, generator)
        change, position, depth, contact = (part[..., rows, cols] for part in (change, position, depth, contact))
        return Windows(vary_change(change, depth, self.settings, generator), position, depth, contact)

    def _draw_window(self, contact: np.ndarray, generator: torch.Generator) -> tuple[slice, ...]:
        """Draw a window's rows and columns, given the contact (rows, cols)."""
        import torch

        about = float(torch.rand(1, generator=generator, dtype=torch.float32))
        anywhere, near = torch.rand((2, 2), generator=generator, dtype=torch.float32).tolist()
        touched, slices = np.argwhere(contact), []
        for axis, size in enumerate(contact.shape):
            side = min(self.settings.window, size)
            first = anywhere[axis] * (size - side)
            if len(touched) and about < AT_CONTACT:
                first = touched[:, axis].mean() - side / 2 + (2 * near[axis] - 1) * side / 3
            start = int(np.clip(first, 0, size - side))
            slices.append(slice(start, start + side))
        return tuple(slices)

    def loss(self, network: nn.Module, batch: Windows) -> Tensor:
        return self._compare(network, batch, uncropped=False)[1]

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Compute the loss over the validation presses, and the mean depth error over all pixels, µm; neither chooses an epoch."""
        loss = error = 0.0
        for items in self.validation_batches():
            windows = _stacked([self._window(self.valid, item, None) for item in items])
            shape, mean = self._compare(network, windows, uncropped=True)
            loss += len(items) * float(mean)
            error += len(items) * float((shape.depth.cpu() - windows.depth).abs().mean())
        return {"loss": loss / len(self.valid), "depth_error_um": 1e3 * error / len(self.valid)}

    def _compare(self, network: nn.Module, windows: Windows, *, uncropped: bool) -> tuple[LocalShape, Tensor]:
        """Read windows; whole presses as a sensor's photographs, parts of them with the true depth at their rims."""
        from pipeline.kernels.networks.local_network import local_loss

        parameter, sensor = next(network.parameters()), self.train.sensor
        pitch = (MM * sensor.pitch[0], MM * sensor.pitch[1])
        depth, contact = windows.depth.to(parameter), windows.contact.to(parameter.device)
        shape = network(windows.change.to(parameter), windows.position.to(parameter), pitch, None if uncropped else depth)
        return shape, local_loss(shape, depth, contact, pitch)


def _stacked(windows: Sequence[Windows]) -> Windows:
    import torch

    return Windows(*map(torch.stack, zip(*windows, strict=True)))


def train_local_network(
    train_presses: Presses,  # of one sensor, to learn from
    valid: Presses,  # of this sensor, to watch
    settings: TouchTrainingSettings,
    *,
    folder: Path,  # gets checkpoint and curves, as `train` writes them
    seed: int,  # of weights, order and variation
) -> tuple[LocalNetwork, dict[str, Any]]:  # network in evaluation mode, facts for a record
    """Train a local network."""
    from pipeline.kernels.networks.local_network import LocalNetwork
    from pipeline.training.loop import train

    with seeded_weights(seed, NAME):
        network = LocalNetwork(settings.width)
    facts = train(PressLearner(network, train_presses, valid, settings), settings, folder=folder, seed=seed, name=NAME)
    return network.eval(), facts


class TrainTouch(Training):
    """Train a small network that reads the gel's depth from changes of colour."""

    name = NAME
    summary = "A local network that reads depth in photographs of a sensor, from simulated presses."
    settings_type = TouchTrainingSettings

    def inputs(self, settings: TouchTrainingSettings) -> tuple[Artifact, ...]:
        return (TOUCH if settings.pretrained else PRESSES,)

    def assets(self, settings: TouchTrainingSettings) -> list[Path]:
        """List the files of the pretrained networks, if one is taken."""
        if settings.pretrained is None:
            return []
        from pipeline.models.shipped_weights import SENSORS, SHIPPED

        return sorted(path for path in (SHIPPED / SENSORS).glob("*/*") if path.is_file())

    def writes(self, settings: TouchTrainingSettings) -> str:
        return "models/touch"

    def cost(self, settings: TouchTrainingSettings, objects: int) -> Cost:
        """Estimate 72 presses per object and epoch; a window's time grows with its pixels and with the width."""
        window = 0.003 * (settings.window / 64) ** 2 * settings.width / 16
        return Cost(seconds=objects * 72 * settings.epochs * window, kilobytes=100)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        """Train, and save the last epoch's weights with the sensor and its untouched image; or save those of the pretrained network."""
        from pipeline.models.touch_model import save_touch_model, shipped_touch_model

        settings: TouchTrainingSettings = job.settings
        if settings.pretrained:
            model = shipped_touch_model(sensor_of(DataDirectory(job.data).collection(TOUCH).first), "cpu")
            save_touch_model(job.folder, model.network, sensor=model.sensor, untouched=model.untouched)
            return {"pretrained": model.sensor.name, "presses": {"train": 0, "valid": 0}}
        presses, valid = (stored_presses(job.data, split, cache_megabytes=settings.cache_megabytes) for split in ("train", "valid"))
        network, facts = train_local_network(presses, valid, settings, folder=job.folder, seed=job.seed)
        save_touch_model(job.folder, network, sensor=presses.sensor, untouched=presses.untouched)
        return facts | {"presses": {"train": len(presses), "valid": len(valid)}}
