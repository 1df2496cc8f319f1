"""The U-Net that turns a tactile image into a depth map (Table 5), contact masks and the losses on them (supplement 2.2)."""

import math
from fractions import Fraction

import torch
from torch import Tensor, nn

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import WHITE, check_shape
from pipeline.kernels.metrics.chamfer import chamfer
from pipeline.kernels.tensors import COLOURS, check_intensities

LEVELS = 4  # poolings on the way down, and deconvolutions on the way up
MIN_SIDE = 2**LEVELS  # fewest pixels per side: with fewer, nothing is left after the last pooling
THRESHOLD = 0.001  # the supplement's: squared distance over colour, of images in [0, 1]


class UNet(nn.Module):
    """Table 5: 27 layers, 24,425,601 parameters at a `width`, the features of the first level, of 64; each level has twice as many.

    Two convolutions and a pooling per level on the way down; a deconvolution, the level's own features and a convolution on the way up.
    Where the table does not add up, layer (10) takes (9), and a deconvolution gives the size of the features it meets: (18) goes from
    12 to 25.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
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
        """Predict the depth of each pixel of tactile images (B, 3, H, W) in [0, 1]: (B, H, W), as a share of the gel's thickness w.

        Times w they are D. In evaluation on a CPU, with initial weights, float32 errs by at most 1e-6, bfloat16 under autocast by 1e-3
        (7 µm of 6.8 mm). In training, batch normalisation refuses a single value per channel, as for one image of less than 32 pixels.
        """
        check_shape("images", images, "B", COLOURS, "H", "W")
        check_intensities("images", images)
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


def _convolution(before: int, after: int, kernel: int) -> nn.Sequential:
    """Make a convolution that keeps the size, batch normalisation and ReLU; a 2 x 2 kernel is padded after the last row and column."""
    far_side = [nn.ZeroPad2d((0, 1, 0, 1))] if kernel % 2 == 0 else []
    convolution = nn.Conv2d(before, after, kernel, padding=(kernel - 1) // 2)
    return nn.Sequential(*far_side, convolution, nn.BatchNorm2d(after), nn.ReLU(inplace=True))


def contact_mask(
    images: Tensor,  # (..., H, W, 3) uint8
    untouched: Tensor,  # (H, W, 3) uint8 image of the same sensor with nothing on it, on the same device
    threshold: float = THRESHOLD,  # in squared intensities: the quantisation to 8 bits alone exceeds 0.001 unsquared
) -> Tensor:  # (..., H, W) bool
    """Find the pixels that touched: those whose squared l2 difference over colour, compared as integers, exceeds the threshold."""
    difference = images.to(torch.int32) - untouched.to(torch.int32)
    return difference.square().sum(dim=-1) > math.floor(Fraction(threshold) * WHITE**2)  # a float would be rounded


def visible_depth(depth: Tensor, gel: float | Tensor) -> Tensor:  # of the shape and type of `depth`
    """Clamp depths D (..., H, W), m, to what an image shows, min(D, w); w is a number, or (H, W) where the gel is curved."""
    if not bool((depth > -math.inf).all()):
        raise InvalidInput("depth holds NaN or -inf; where nothing is met it must be +inf")
    return depth.minimum(torch.as_tensor(gel, dtype=depth.dtype, device=depth.device))


def masked_depth_loss(
    predicted: Tensor,  # (B, H, W) m; float32 or float64, finite
    depth: Tensor,  # (B, H, W) true depth D, m, +inf where nothing is met
    mask: Tensor,  # (B, H, W) bool, from `contact_mask`
    *,
    width: float,  # of the sensor plane, m
    gel: float | Tensor,  # the gel's thickness w, m, to which true depths are clamped; (H, W) where the gel is curved
) -> Tensor:  # a scalar in sensor widths squared; its root errs in float32 by less than 1e-6 of itself and 3e-7 (5 nm)
    """Compute the mean over touches of the mean squared depth error over their masked pixels, 0 where there are none."""
    _check(predicted)
    error = torch.where(mask, predicted - visible_depth(depth, gel).to(predicted.dtype), 0) / width  # (B, H, W)
    touch_errors = error.square().sum(dim=(1, 2)) / mask.sum(dim=(1, 2)).clamp(min=1)
    return touch_errors.mean()


def projected_chamfer_loss(
    predicted: Tensor, depth: Tensor, mask: Tensor, *, width: float, gel: float | Tensor, aspect: float = 1.0
) -> Tensor:  # as `masked_depth_loss`; aspect: the sensor's height over its width
    """Compute the mean over touches of the Chamfer distance between predicted and true points of masked pixels, sensor frame."""
    _check(predicted)
    true = visible_depth(depth, gel).to(predicted.dtype)
    total = (predicted * 0).sum()  # keeps the graph if every mask is empty
    for item in range(len(predicted)):
        row, col = mask[item].nonzero(as_tuple=True)
        if len(row):
            clouds = [_points(image[item, row, col], row, col, mask.shape[1:], width, aspect) for image in (predicted, true)]
            total = total + chamfer(*clouds)
    return total / len(predicted)


def _points(depth: Tensor, row: Tensor, col: Tensor, shape: torch.Size, width: float, aspect: float) -> Tensor:
    """Compute the points (n, 3) of pixels, sensor frame, sensor widths."""
    x = (col.to(depth.dtype) + 0.5) / shape[1] - 0.5
    y = ((row.to(depth.dtype) + 0.5) / shape[0] - 0.5) * aspect
    return torch.stack([x, y, depth / width], dim=1)


def _check(predicted: Tensor) -> None:
    if count := int((~torch.isfinite(predicted)).flatten(1).any(dim=1).sum()):
        touches = f"{count} of {len(predicted)} touches"
        raise InvalidInput(f"predicted depth holds infinity or NaN in {touches}: the network has diverged; lower the learning rate")
