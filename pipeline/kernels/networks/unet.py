"""The U-Net that turns a tactile image into a depth map (Table 5)."""

import torch
from torch import Tensor, nn

from pipeline.errors import InvalidInput
from pipeline.kernels.tensor_checks import COLOURS, check_full_precision, check_intensities

LEVELS = 4  # poolings on the way down, and deconvolutions on the way up
MIN_SIDE = 2**LEVELS  # fewest pixels per side: with fewer, nothing is left after the last pooling


class UNet(nn.Module):
    """Table 5: 27 layers, 24,425,601 parameters at width 64.

    Two convolutions and a pooling per level on the way down; a deconvolution, the level's own features and a convolution on the way up.
    Where the table does not add up, layer (10) takes (9), and a deconvolution gives the size of the features it meets: (18) goes from
    12 to 25.

    `width` counts the features of the first level, 64 in the supplement; each level has twice those of the one before.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        if width < 1:
            raise ValueError(f"a U-Net of width {width}: the first level needs at least 1 feature; Table 5 has 64")
        self.width = width
        widths = [width * 2**level for level in range(LEVELS + 1)]
        self.down = nn.ModuleList(
            nn.Sequential(_convolution(before, after, 3), _convolution(after, after, 3))
            for before, after in zip([COLOURS, *widths], widths, strict=False)
        )
        self.pool = nn.MaxPool2d(2)
        up = list(zip(widths[:0:-1], widths[-2::-1], strict=True))  # (16, 8), (8, 4), (4, 2), (2, 1) times width
        self.up = nn.ModuleList(nn.ConvTranspose2d(below, above, 2, stride=2) for below, above in up)
        self.merge = nn.ModuleList(_convolution(below, above, 2) for below, above in up)
        self.head = nn.Conv2d(width, 1, 1)

    def forward(self, images: Tensor) -> Tensor:
        """Predict the depth of each pixel of tactile images, (B, H, W), as a share of the gel's thickness w.

        Images (B, 3, H, W) are in [0, 1], of the parameters' type and device; H and W are at least 16. Shares are in
        [0, 1]: times w they are D, the distance from the sensor plane. In evaluation on a CPU, with initial weights,
        float32 errs by at most 1e-6, bfloat16 under autocast by 1e-3 (7 µm of 6.8 mm). In training, batch normalisation
        refuses a single value per channel, as for one image of less than 32 pixels per side.
        """
        self._check(images)
        features, skips = images, []
        for level, convolutions in enumerate(self.down):
            features = convolutions(self.pool(features) if level else features)
            skips.append(features)
        for deconvolution, merge, skip in zip(self.up, self.merge, skips[-2::-1], strict=True):
            features = deconvolution(features, output_size=skip.shape[-2:])
            features = merge(torch.cat([features, skip], dim=1))
        with torch.autocast(features.device.type, enabled=False):  # bfloat16's 8 bits would leave steps of tens of micrometres
            logits = self.head(features.to(self.head.weight.dtype))
        return torch.sigmoid(logits[:, 0])

    def _check(self, images: Tensor) -> None:
        if images.ndim != 4 or images.shape[1] != COLOURS:
            raise ValueError(f"images have shape {tuple(images.shape)}; the U-Net takes (B, {COLOURS}, H, W)")
        batch, _, rows, cols = images.shape
        if min(rows, cols) < MIN_SIDE:
            raise InvalidInput(f"images of {rows} x {cols} pixels; {LEVELS} poolings need at least {MIN_SIDE} per side")
        check_full_precision("a U-Net with parameters", self.head.weight)
        check_intensities("images", images)
        if self.training and batch * (rows // MIN_SIDE) * (cols // MIN_SIDE) < 2:
            raise InvalidInput(
                f"{batch} image of {rows} x {cols} pixels has one value per channel at the lowest level, which batch normalisation "
                "cannot train on; take a batch of 2 or more, or .eval()"
            )


def _convolution(before: int, after: int, kernel: int) -> nn.Sequential:
    """Make a convolution that keeps the size, batch normalisation and ReLU; a 2 x 2 kernel is padded after the last row and column."""
    far_side = [nn.ZeroPad2d((0, 1, 0, 1))] if kernel % 2 == 0 else []
    convolution = nn.Conv2d(before, after, kernel, padding=(kernel - 1) // 2)
    return nn.Sequential(*far_side, convolution, nn.BatchNorm2d(after), nn.ReLU(inplace=True))
