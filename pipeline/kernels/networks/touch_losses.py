"""Losses of predicted depth maps on the pixels that touched (supplement 2.2): in depth, or between point clouds."""

import math

import torch
from torch import Tensor

from pipeline.errors import InvalidInput
from pipeline.kernels.metrics.chamfer import chamfer
from pipeline.kernels.tensor_checks import check_full_precision


def visible_depth(
    depth: Tensor,  # (..., H, W) D, m, +inf where nothing is met
    gel: float | Tensor,  # w, the gel's thickness, m; (H, W), its height at each pixel, where it is curved
) -> Tensor:  # of the shape and type of `depth`
    """Clamp depths to what a tactile image can show, min(D, w): it is a function of ReLU(w - D) alone (equation 1)."""
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
) -> Tensor:  # a scalar in sensor widths squared, of `predicted`'s type, differentiable in it
    """Compute the mean over the batch of each touch's mean squared depth error over its masked pixels.

    A touch whose mask is empty has loss 0 and gradient 0. In float32 the loss's root errs by less than 1e-6 of itself
    and 3e-7 sensor widths (5 nm).
    """
    _check(predicted, depth, mask)
    error = torch.where(mask, predicted - visible_depth(depth, gel).to(predicted.dtype), 0) / width  # (B, H, W)
    touch_errors = error.square().sum(dim=(1, 2)) / mask.sum(dim=(1, 2)).clamp(min=1)
    return touch_errors.mean()


def projected_chamfer_loss(
    predicted: Tensor,
    depth: Tensor,
    mask: Tensor,
    *,
    width: float,
    gel: float | Tensor,
    aspect: float = 1.0,  # the sensor's height over its width
) -> Tensor:
    """Compute the mean over the batch of the Chamfer distance between predicted and true local points.

    A masked pixel is the point (x, y, D) of the sensor frame; a touch whose mask is empty has loss 0. Other parameters
    and the result are those of `masked_depth_loss`.
    """
    _check(predicted, depth, mask)
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


def _check(predicted: Tensor, depth: Tensor, mask: Tensor) -> None:
    if predicted.ndim != 3 or not (predicted.shape == depth.shape == mask.shape) or not len(predicted):
        shapes = ", ".join(str(tuple(tensor.shape)) for tensor in (predicted, depth, mask))
        raise ValueError(f"predicted, depth and mask have shapes {shapes}; all must be one (B, H, W) with B >= 1")
    if mask.dtype != torch.bool or not (predicted.is_floating_point() and depth.is_floating_point()):
        raise ValueError(f"predicted is {predicted.dtype}, depth {depth.dtype}, mask {mask.dtype}; they must be floating, floating, bool")
    check_full_precision("predicted depth", predicted)
    if count := int((~torch.isfinite(predicted)).flatten(1).any(dim=1).sum()):
        raise InvalidInput(
            f"predicted depth holds infinity or NaN in {count} of {len(predicted)} touches: the network has diverged; lower the learning "
            "rate"
        )
