"""The U-Net that turns a tactile reading into a depth map (Table 5)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.kernels.metrics.precision import check_full
from pipeline.kernels.networks.images import check_intensities

LEVELS = 4
"""Poolings on the way down, and deconvolutions on the way up."""
SMALLEST = 2**LEVELS
"""Pixels a side below which nothing is left after the last pooling."""


class UNet(nn.Module):
    """Table 5: 27 layers, 24,425,601 parameters at width 64.

    Two convolutions and a pooling a level on the way down, a deconvolution, the level's own features and a convolution on
    the way up. Where the table does not add up, (10) takes (9), and a deconvolution gives the size of the features it
    meets: (18) goes from 12 to 25.

    Parameters
    ----------
    width
        Features of the first level; every level has twice those of the one before. 64 is the supplement's.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        if width < 1:
            raise ValueError(f"a U-Net of width {width}: the first level needs at least 1 feature; Table 5 has 64")
        self.width = width
        widths = [width * 2**level for level in range(LEVELS + 1)]
        self.down = nn.ModuleList(
            nn.ModuleList([_convolution(before, after, 3), _convolution(after, after, 3)])
            for before, after in zip([3, *widths], widths, strict=False)
        )
        self.pool = nn.MaxPool2d(2)
        up = list(zip(widths[:0:-1], widths[-2::-1], strict=True))  # (16, 8), (8, 4), (4, 2), (2, 1) times width
        self.up = nn.ModuleList(nn.ConvTranspose2d(below, here, 2, stride=2) for below, here in up)
        self.merge = nn.ModuleList(_convolution(below, here, 2) for below, here in up)
        self.head = nn.Conv2d(width, 1, 1)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a tenth faster on a CPU

    def forward(self, readings: Tensor) -> Tensor:
        """Depth of every pixel as a share of the gel's thickness w.

        Parameters
        ----------
        readings
            (B, 3, H, W) in [0, 1], of the parameters' type and device; H and W at least 16.

        Returns
        -------
        (B, H, W) in [0, 1], by a sigmoid; times w it is D, the distance from the sensor plane. In evaluation on a CPU, with
        initial weights, float32 errs by at most 1e-6, bfloat16 under autocast by 1e-3 (7 µm of 6.8 mm). In training, a batch whose
        every reading is black is normalised to rounding noise: depths are finite, but not the same in float32 and float64.

        Raises
        ------
        ValueError
            The shape is another one; readings hold NaN or leave [0, 1]; the parameters are of half precision, in which depths
            would have steps of tens of micrometres (autocast keeps them); or, in training, batch normalisation meets a single
            value a channel, as for one reading of less than 32 pixels a side: take a larger batch.
        """
        logits = deque(self.layers(readings), maxlen=1).pop()  # evaluation keeps no layer it no longer needs
        return torch.sigmoid(logits[:, 0])

    def layers(self, readings: Tensor) -> Iterator[Tensor]:
        """The outputs of Table 5's layers (1) to (27), one after the other; the last is (B, 1, H, W), before the sigmoid."""
        self._check(readings)
        features, skips = readings, []
        for level, block in enumerate(self.down):
            if level:
                features = self.pool(features)
                yield features
            for convolution in block:  # type: ignore[attr-defined]
                features = convolution(features)
                yield features
            skips.append(features)
        skips.pop()
        for deconvolution, merge in zip(self.up, self.merge, strict=True):
            skip = skips.pop()
            features = deconvolution(features, output_size=skip.shape[-2:])
            yield features
            features = torch.cat([features, skip], dim=1)
            yield features
            features = merge(features)
            yield features
        with torch.autocast(features.device.type, enabled=False):  # bfloat16's 8 bits would leave steps of tens of micrometres
            logits: Tensor = self.head(features.to(self.head.weight.dtype))
        yield logits

    def _check(self, readings: Tensor) -> None:
        if readings.ndim != 4 or readings.shape[1] != 3:
            raise ValueError(f"readings have shape {tuple(readings.shape)}; the U-Net takes (B, 3, H, W)")
        batch, _, rows, cols = readings.shape
        if min(rows, cols) < SMALLEST:
            raise ValueError(f"readings of {rows} x {cols} pixels; {LEVELS} poolings need at least {SMALLEST} a side")
        check_full("a U-Net with parameters", self.head.weight)
        check_intensities("readings", readings)
        if self.training and batch * (rows // SMALLEST) * (cols // SMALLEST) < 2:
            raise ValueError(
                f"{batch} reading of {rows} x {cols} pixels has one value a channel at the lowest level, which batch normalisation "
                "cannot train on; take a batch of 2 or more, or .eval()"
            )


def _convolution(before: int, after: int, kernel: int) -> nn.Sequential:
    """Conv + BN + ReLU that keeps the size; a 2 x 2 kernel is padded at the far side, by hand since padding="same" warns."""
    layers: list[nn.Module] = [nn.Conv2d(before, after, kernel, padding=(kernel - 1) // 2), nn.BatchNorm2d(after), nn.ReLU(inplace=True)]
    return nn.Sequential(*([_FarSide()] if kernel % 2 == 0 else []), *layers)


class _FarSide(nn.Module):
    """One row and one column of zeros, last."""

    def forward(self, features: Tensor) -> Tensor:
        return functional.pad(features, (0, 1, 0, 1))
