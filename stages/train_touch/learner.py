"""The training of a local network on presses: windows about contacts, varied, with the truth of the gel."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, interpolate, pad

from pipeline.kernels.networks.local_network import GelState, LocalNetwork, LocalShape, local_loss, pixel_positions
from pipeline.kernels.touch.sensor import MM
from pipeline.rng import seeded_weights
from pipeline.training.learner import Learner
from pipeline.training.loop import train
from stages.train_touch.presses import Presses
from stages.train_touch.stage import TouchTrainingSettings

NAME = "train-touch"
AT_CONTACT = 0.85
"""Share of the windows that lie about a contact; the others lie anywhere."""
DRIFT_SIDE = 3
"""Points per side between which drift is interpolated: it is smooth."""


class Windows(NamedTuple):
    """Windows of some presses."""

    change: Tensor  # (B, 3, H, W) change of colours, levels
    position: Tensor  # (B, 2, H, W)
    truth: GelState


class PressLearner(Learner):
    """A local network with its presses."""

    keeps_last = True

    def __init__(self, network: LocalNetwork, train: Presses, valid: Presses, settings: TouchTrainingSettings) -> None:
        super().__init__(network)
        self.train, self.valid, self.settings = train, valid, settings
        self.pitch = (MM * train.sensor.pitch[0], MM * train.sensor.pitch[1])
        self.position = pixel_positions(*train.sensor.shape)[0]

    def __len__(self) -> int:
        return len(self.train)

    def describe(self, item: int) -> str:
        """Name a training press."""
        return self.train.names[item]

    def read(self, items: Sequence[int], generators: Sequence[torch.Generator]) -> Windows:
        """Read a varied window of each press."""
        return _stacked([self._window(self.train, item, generator) for item, generator in zip(items, generators, strict=True)])

    def _window(self, presses: Presses, item: int, generator: torch.Generator | None) -> Windows:
        """Read a window of a press, or without a generator the whole press, as it is."""
        press = presses.read(item)
        change = torch.from_numpy(press.image.astype(np.float32) - presses.untouched).permute(2, 0, 1)
        depth, contact = torch.from_numpy(MM * press.indentation), torch.from_numpy(press.contact.copy())
        position = self.position
        if generator is not None:
            rows, cols = self._place(press.contact, generator)
            change, position = change[:, rows, cols], position[:, rows, cols]
            depth, contact = depth[rows, cols], contact[rows, cols]
            change = vary_change(change, depth, self.settings, generator)
        return Windows(change, position, GelState(depth, contact))

    def _place(self, contact: np.ndarray, generator: torch.Generator) -> tuple[slice, slice]:
        """Draw a window's rows and columns, given the contact (rows, cols)."""
        about, share, place = (
            torch.rand(1, generator=generator, dtype=torch.float32),
            *torch.rand((2, 2), generator=generator, dtype=torch.float32),
        )
        touched = np.argwhere(contact)
        slices = []
        for axis, size in enumerate(contact.shape):
            side = min(self.settings.window, size)
            first = float(share[axis]) * (size - side)
            if len(touched) and float(about) < AT_CONTACT:
                first = touched[:, axis].mean() - side / 2 + (2 * float(place[axis]) - 1) * side / 3
            start = int(np.clip(first, 0, size - side))
            slices.append(slice(start, start + side))
        return slices[0], slices[1]

    def loss(self, network: nn.Module, batch: Windows) -> Tensor:
        """Compute the loss of some training windows."""
        return self._read(network, batch, uncropped=False)[1]

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Compute the loss over the validation presses, and the mean depth error over all pixels, µm; neither chooses an epoch."""
        loss = error = 0.0
        for start in range(0, len(self.valid), self.settings.batch_size):
            items = range(len(self.valid))[start : start + self.settings.batch_size]
            windows = _stacked([self._window(self.valid, item, None) for item in items])
            shape, mean = self._read(network, windows, uncropped=True)
            loss += len(items) * float(mean)
            error += len(items) * float((shape.depth.cpu() - windows.truth.depth).abs().mean())
        return {"loss": loss / len(self.valid), "depth_error_um": 1e3 * error / len(self.valid)}

    def _read(self, network: nn.Module, windows: Windows, *, uncropped: bool) -> tuple[LocalShape, Tensor]:
        """Read windows; whole presses as a sensor's photographs, parts of them with the true depth at their rims."""
        parameter = next(network.parameters())
        truth = GelState(windows.truth.depth.to(parameter), windows.truth.contact.to(parameter.device))
        shape = network(windows.change.to(parameter), windows.position.to(parameter), self.pitch, None if uncropped else truth.depth)
        return shape, local_loss(shape, truth, self.pitch)


def _stacked(windows: Sequence[Windows]) -> Windows:
    change, position, truth = zip(*windows, strict=True)
    depth, contact = zip(*truth, strict=True)
    return Windows(torch.stack(change), torch.stack(position), GelState(torch.stack(depth), torch.stack(contact)))


def train_local_network(
    train_presses: Presses,  # of one sensor, to learn from
    valid: Presses,  # of this sensor, to watch
    settings: TouchTrainingSettings,
    *,
    folder: Path,  # gets checkpoint and curves, as `train` writes them
    seed: int,  # of weights, order and variation
) -> tuple[LocalNetwork, dict[str, Any]]:  # network in evaluation mode, facts for a record
    """Train a local network."""
    with seeded_weights(seed, NAME):
        network = LocalNetwork(settings.width)
    facts = train(PressLearner(network, train_presses, valid, settings), settings, folder=folder, seed=seed, name=NAME)
    return network.eval(), facts


def vary_change(
    change: Tensor,  # (3, H, W) float32 image minus untouched image, levels
    depth: Tensor,  # (H, W) float32 mm, how deep the gel is drawn in
    settings: TouchTrainingSettings,  # give the ranges; at 0 each variation is off
    generator: torch.Generator,
) -> Tensor:
    """Vary the change of colours of one press.

    Variations are gain, mixed colours, light that grows with the depth, blur, drift, noise and shift.
    """

    def share(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator, dtype=torch.float32)

    gain = 1 + settings.image_gain * (2 * share(3) - 1) + 1.5 * settings.image_gain * (2 * share(1) - 1)
    mixing = torch.eye(3, dtype=torch.float32) + settings.image_mix * (2 * share(3, 3) - 1)
    varied = torch.einsum("ij,jhw->ihw", gain[:, None] * mixing, change)
    lit = torch.randn((3, 1, 1), generator=generator, dtype=torch.float32)
    varied = varied + settings.image_depth * lit * depth
    varied = _blurred(varied, settings.image_blur * float(share(1)))
    coarse = torch.randn((3, DRIFT_SIDE, DRIFT_SIDE), generator=generator, dtype=torch.float32)
    common = torch.randn((1, DRIFT_SIDE, DRIFT_SIDE), generator=generator, dtype=torch.float32)
    drift = interpolate((0.6 * coarse + common)[None], size=change.shape[1:], mode="bicubic", align_corners=True)[0]
    noise = torch.randn(change.shape, generator=generator, dtype=torch.float32)
    varied = varied + settings.image_drift * share(1) * drift + settings.image_noise * share(1) * noise
    return varied + settings.image_shift * (2 * share(3, 1, 1) - 1)


def _blurred(image: Tensor, sigma: float) -> Tensor:
    """Blur an image (3, H, W) by a Gaussian of standard deviation `sigma`, pixels."""
    if sigma < 0.1:
        return image
    reach = max(1, round(3 * sigma))
    weights = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=image.dtype) / sigma) ** 2)
    weights = (weights / weights.sum()).view(1, 1, 1, -1)
    padded = pad(image[:, None], (reach, reach, reach, reach), mode="replicate")
    return conv2d(conv2d(padded, weights), weights.transpose(2, 3))[:, 0]
