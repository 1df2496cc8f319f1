"""Perceptual feature pooling: each vertex takes the image features at the pixel where it is seen (supplement 3.1)."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.image_encoder import MapGrid
from pipeline.kernels.tensor_checks import check_full_precision

NEAREST_DEPTH = 0.01
"""m; nearer points are moved to this depth. Cameras are farther than 0.5 m from objects of the size that networks see."""


def project_to_pixels(
    camera: Tensor,  # (3, 4) or, one per item, (B, 3, 4): world points to pixels; its third row measures depth in m
    points: Tensor,  # (B, N, 3) world, m; float32 or float64, as the camera
) -> Tensor:  # (B, N, 2) column and row, pixels, pixel centres at 1/2
    """Project world points into an image.

    A point nearer to the camera than `NEAREST_DEPTH`, or behind it, is first moved along the viewing direction to that
    depth: it falls far outside the image on its own side, and each coordinate and gradient is finite. In float32 a
    coordinate errs by at most 1e-6 · Σ |camera| |point| / depth: 1e-3 pixels in the scene.
    """
    if camera.shape not in {(3, 4), (len(points), 3, 4)} or points.ndim != 3 or points.shape[2] != 3:
        raise ValueError(
            f"camera is {tuple(camera.shape)} and points {tuple(points.shape)}: they must be (3, 4) or (B, 3, 4), and (B, N, 3)"
        )
    check_full_precision("points", points)
    if camera.dtype != points.dtype:
        raise ValueError(f"camera is {camera.dtype}, points are {points.dtype}: they must be of one type")
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
    """Interpolate feature maps bilinearly at image coordinates.

    A feature belongs to the centre of its receptive field, which unpadded convolutions shift against the map: maps are
    indexed by these centres, never by the ratio of widths. Beyond the outermost centres, features are those of the
    nearest point on the border. Gradients flow to `pixels` as well, and are zero beyond the outermost centres.
    """
    pooled = []
    for features, grid in zip(maps, grids, strict=True):
        if features.ndim != 4 or pixels.ndim != 3 or len(features) != len(pixels) or pixels.shape[2] != 2:
            raise ValueError(f"a map is {tuple(features.shape)} and pixels {tuple(pixels.shape)}: they must be (B, C, H, W) and (B, N, 2)")
        last = pixels.new_tensor([features.shape[3] - 1, features.shape[2] - 1])  # (2,) index of the last column and row
        index = (pixels - grid.start) / grid.jump
        normalised = 2 * index / last.clamp(min=1) - 1  # -1 and 1 are the outermost centres
        sampled = functional.grid_sample(features.to(pixels.dtype), normalised[:, None], padding_mode="border", align_corners=True)
        pooled.append(sampled[:, :, 0])  # (B, channels, N)
    return torch.cat(pooled, dim=1).mT
