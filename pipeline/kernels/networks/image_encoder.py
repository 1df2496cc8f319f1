"""Image encoders: stacks of convolutions (Tables 7-11), whose features are pooled at the pixel where a vertex is seen (supplement 3.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import gcd

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import check_shape
from pipeline.kernels.networks.network_configurations import NetworkInputs, Norm
from pipeline.kernels.tensors import COLOURS, check_intensities

GROUPS = 8  # most groups of channels of a group normalisation; fewer where groups would have different sizes
NEAREST_DEPTH = 0.01  # m, to which nearer points are moved; cameras are farther than 0.5 m from objects as networks see them


@dataclass(frozen=True)
class EncoderPlan:
    """An image encoder as data."""

    layers: tuple[tuple[int, int], ...]  # (channels, stride) of each: a convolution, a normalisation and a ReLU
    taps: tuple[int, ...]  # layers whose maps are pooled, counted from 1 as in the tables
    resolution: int = 256  # pixels per side of the images it is made for
    shrinks: bool = True
    """Whether each layer removes one pixel on each side of its map, 3 × 3 unpadded or 5 × 5 padded by one. If not,
    strides alone make maps smaller."""


@dataclass(frozen=True)
class MapGrid:
    """Where the receptive fields of a map's elements are centred: element i of a row or column at `start + jump · i` image pixels."""

    start: float = 0.5
    jump: int = 1

    def after(self, kernel: int, stride: int, padding: int) -> "MapGrid":
        """Compute the grid, in image pixels, of the map that a convolution, in pixels of this map, makes of it."""
        return MapGrid(self.start + self.jump * ((kernel - 1) / 2 - padding), self.jump * stride)


def _blocks(channels: tuple[int, ...], lengths: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """List layers in blocks of equal channels, each block's first layer with stride 2."""
    return tuple((width, 1 if index else 2) for width, length in zip(channels, lengths, strict=True) for index in range(length))


ENCODER_PLANS: Mapping[int, EncoderPlan] = {  # by number of layers
    12: EncoderPlan(_blocks((16, 32, 64, 128), (3, 3, 3, 3)), taps=(3, 6, 9, 12)),  # Table 10, whose tap "(11)" is (12)
    15: EncoderPlan(_blocks((16, 32, 64, 128), (4, 4, 4, 3)), taps=(8, 12, 15)),  # of the search grid of 3.4; no table
    18: EncoderPlan(_blocks((16, 32, 64, 128), (5, 5, 5, 3)), taps=(10, 15, 18)),  # Tables 7-9
    25: EncoderPlan(  # Table 11
        _blocks((16, 32, 64, 128, 256), (5, 5, 5, 5, 5)), taps=(7, 10, 13, 16, 19, 22, 25), resolution=137, shrinks=False
    ),
}


class PlanarGroupNorm(nn.GroupNorm):
    """Group normalisation of maps whose channels are last in memory: on CPUs torch's own is a fifth as fast as that of rearranged maps."""

    def forward(self, maps: Tensor) -> Tensor:
        """Normalise (B, C, H, W) maps."""
        if maps.is_cuda:
            return super().forward(maps)
        return super().forward(maps.contiguous()).contiguous(memory_format=torch.channels_last)


def _normalisation(norm: Norm, channels: int) -> nn.Module:
    if norm == "batch":
        return nn.BatchNorm2d(channels)
    return nn.InstanceNorm2d(channels) if norm == "instance" else PlanarGroupNorm(gcd(GROUPS, channels), channels)


class ImageEncoder(nn.Module):
    """Computes feature maps of images at several depths.

    Convolutions are of 3 pixels per side (the tables) or 5 (the authors' release), normalisation is "batch" (Tables 7-10), "instance"
    (Table 11), or "group", of groups of channels of one image; channels are rounded, one at least. `grids` hold where the elements of each
    tapped map are centred, `channels` counts those of all tapped maps together, `deepest` those of the last one.
    """

    def __init__(self, inputs: NetworkInputs) -> None:
        super().__init__()
        plan, kernel, norm, width = ENCODER_PLANS[inputs.encoder_layers], inputs.encoder_kernel, inputs.encoder_norm, inputs.encoder_width
        self.plan, self.kernel, self.norm = plan, kernel, norm
        self.padding = (kernel - 3) // 2 if plan.shrinks else (kernel - 1) // 2
        channels = [COLOURS, *(max(1, round(count * width)) for count, _ in plan.layers)]
        layers, grids = [], [MapGrid()]
        for (before, after), (_, stride) in zip(pairwise(channels), plan.layers, strict=True):
            convolution = nn.Conv2d(before, after, kernel, stride, self.padding)
            layers.append(nn.Sequential(convolution, _normalisation(norm, after), nn.ReLU(inplace=True)))
            grids.append(grids[-1].after(kernel, stride, self.padding))
        self.layers = nn.ModuleList(layers)
        self.grids = tuple(grids[tap] for tap in plan.taps)
        self.channels = sum(channels[tap] for tap in plan.taps)
        self.deepest = channels[plan.taps[-1]]

    def forward(self, images: Tensor) -> list[Tensor]:
        """Compute the tapped maps, (B, channels, rows, columns) each, of images (B, 3, H, W) in [0, 1].

        In float32 on a CPU they err by at most 1e-4 of their largest value; under bfloat16's autocast by 5 % in evaluation with batch
        normalisation, by half after 25 layers of instance normalisation. A map without contrast, as of a black image, is normalised to
        rounding noise (batch normalisation in training, instance normalisation always): repeatable, but not the same in both precisions.
        """
        check_shape("images", images, "B", COLOURS, "H", "W")
        check_intensities("images", images)
        self._check_size(images)
        features, tapped = images.contiguous(memory_format=torch.channels_last), []  # so convolutions are faster on CPUs
        for index, layer in enumerate(self.layers, start=1):
            features = layer(features)
            if index in self.plan.taps:
                tapped.append(features)
        return tapped

    def _check_size(self, images: Tensor) -> None:
        per_image = self.norm != "batch" or (self.training and len(images) == 1)  # one map has to hold several values to normalise
        size = tuple(images.shape[2:])
        for index, (_, stride) in enumerate(self.plan.layers, start=1):
            size = tuple((side + 2 * self.padding - self.kernel) // stride + 1 for side in size)
            if min(size) < 1 or (per_image and size == (1, 1)):
                left = f"leave layer {index} of {len(self.layers)} a map of {size[0]} x {size[1]}, too few values to normalise"
                raise InvalidInput(f"{len(images)} images of {images.shape[2]} x {images.shape[3]} pixels {left}; take larger images")


def project_to_pixels(
    camera: Tensor,  # (3, 4) or, one per item, (B, 3, 4): world points to pixels; its third row measures depth in m
    points: Tensor,  # (B, N, 3) world, m; float32 or float64, as the camera
) -> Tensor:  # (B, N, 2) column and row, pixels, pixel centres at 1/2
    """Project world points into an image.

    A point nearer to the camera than `NEAREST_DEPTH`, or behind it, is first moved along the viewing direction to that depth: it falls
    far outside the image on its own side, and each coordinate and gradient is finite. In float32 a coordinate errs by at most
    1e-6 · Σ |camera| |point| / depth: 1e-3 pixels in the scene.
    """
    for name, values in (("camera", camera), ("points", points)):
        if not bool(torch.isfinite(values).all()):
            raise InvalidInput(f"NaN or infinity in {name}: if a network moved points there, it has diverged; lower the learning rate")
    rotation, offset = camera[..., :3], camera[..., None, :, 3]
    with torch.autocast(points.device.type, enabled=False):  # in half precision a vertex would be seen pixels away
        homogeneous = points @ rotation.mT + offset  # (B, N, 3): column · depth, row · depth, depth
        forward = rotation[..., 2, :, None]  # (…, 3, 1) unit viewing direction
        principal = (rotation[..., :2, :] @ forward).mT  # (…, 1, 2) what one metre along it adds to column · depth and row · depth
    depth = homogeneous[..., 2:].clamp(min=NEAREST_DEPTH)
    return (homogeneous[..., :2] + (depth - homogeneous[..., 2:]) * principal) / depth


def pool_features(
    maps: Sequence[Tensor],  # (B, channels, rows, columns) each
    grids: Sequence[MapGrid],  # where the elements of each map are centred in the image
    pixels: Tensor,  # (B, N, 2) column and row, pixels, finite as those of `project_to_pixels`
) -> Tensor:  # (B, N, C): the features of one map after the other, C channels in all
    """Interpolate feature maps bilinearly at image coordinates; beyond the outermost elements, features are those of the border.

    A feature belongs to the centre of its receptive field, which unpadded convolutions shift against the map: maps are indexed by these
    centres, never by the ratio of widths. Gradients flow to `pixels` as well, and are zero beyond the outermost centres.
    """
    pooled = []
    for features, grid in zip(maps, grids, strict=True):
        last = pixels.new_tensor([features.shape[3] - 1, features.shape[2] - 1])  # (2,) index of the last column and row
        index = (pixels - grid.start) / grid.jump
        normalised = 2 * index / last.clamp(min=1) - 1  # -1 and 1 are the outermost centres
        sampled = functional.grid_sample(features.to(pixels.dtype), normalised[:, None], padding_mode="border", align_corners=True)
        pooled.append(sampled[:, :, 0])  # (B, channels, N)
    return torch.cat(pooled, dim=1).mT
