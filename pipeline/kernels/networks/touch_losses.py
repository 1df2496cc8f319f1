"""What a predicted depth map is judged by, on the pixels that touched (supplement 2.2): depth, or distance between clouds."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import Target, one_way
from pipeline.kernels.metrics.precision import check_full


def visible_depth(depth: Tensor, gel: float) -> Tensor:
    """Depth as far as a reading can show it: min(D, w), shape and unit of `depth`; a `ValueError` for NaN and -inf.

    A reading is a function of ReLU(w - D) alone (equation 1). Pixels at the rim of a contact differ from the untouched ones by
    the slope to their neighbours and may have any D >= w, +inf too; what they show is the gel's undeformed surface, w.
    """
    if not bool((depth > -math.inf).all()):
        raise ValueError("depth holds NaN or -inf; where nothing is met it must be +inf")
    return depth.clamp(max=gel)


def masked_depth_loss(predicted: Tensor, depth: Tensor, mask: Tensor, width: float, gel: float) -> Tensor:
    """Mean over the batch of each touch's mean squared depth error over its masked pixels, in sensor widths squared.

    Parameters
    ----------
    predicted
        (B, H, W) depth, m; float32 or float64, finite.
    depth
        (B, H, W) true depth D, m, +inf where nothing is met.
    mask
        (B, H, W) bool, from `contact_mask`. A touch whose mask is empty has loss 0 and gradient 0.
    width, gel
        Of the sensor, m: its side, and the gel's thickness w, to which true depths are clamped (`visible_depth`).

    Returns
    -------
    A scalar of `predicted`'s type, differentiable in it. In float32 its root errs by less than 1e-6 of itself and 3e-7 sensor
    widths, 5 nm (beyond a width, 3e-7 of the largest depth).

    Raises
    ------
    ValueError
        Shapes or types that do not fit, half precision, an empty batch, a width or gel that is not positive and finite, NaN or
        infinity in the prediction, NaN or -inf in the truth.
    """
    _check(predicted, depth, mask, width, gel)
    error = torch.where(mask, predicted - visible_depth(depth, gel).to(predicted.dtype), 0) / width  # (B, H, W)
    each = error.square().sum(dim=(1, 2)) / mask.sum(dim=(1, 2)).clamp(min=1)
    return each.mean()


def projected_chamfer_loss(
    predicted: Tensor,
    depth: Tensor,
    mask: Tensor,
    width: float,
    gel: float,
    points: int | None = None,
    generator: torch.Generator | None = None,
) -> Tensor:
    """Mean over the batch of the Chamfer distance between predicted and true local points, in sensor widths squared.

    A masked pixel is the point (x, y, D) of the sensor frame. Mean squared nearest distance, exact, both directions summed.

    Parameters
    ----------
    predicted, depth, mask, width, gel
        As in `masked_depth_loss`.
    points
        How many points a touch are looked up in each direction; None for all. They are drawn without repetition and looked
        up among *all* points of the other cloud, hence the loss is unbiased, and still zero for the true depth.
    generator
        A CPU generator, needed to draw `points`.

    Returns, Raises
    ---------------
    As `masked_depth_loss`; also a `ValueError` for `points` without `generator`.
    """
    _check(predicted, depth, mask, width, gel)
    if points is not None and (points < 1 or generator is None):
        raise ValueError(f"points {points}, generator {generator}; a draw needs at least 1 point and a generator, or points None for all")
    true = visible_depth(depth, gel).to(predicted.dtype)
    total = (predicted * 0).sum()  # keeps the graph where no mask holds a pixel
    for item in range(len(predicted)):
        row, col = mask[item].nonzero(as_tuple=True)
        if not len(row):
            continue
        clouds = [_points(image[item, row, col], row, col, mask.shape[1:], width) for image in (predicted, true)]
        if points is not None and points < len(row):
            chosen = torch.randperm(len(row), generator=generator)[:points].to(row.device)
        else:
            chosen = torch.arange(len(row), device=row.device)
        total = total + sum(one_way(a[chosen], Target(b)).mean() for a, b in (clouds, clouds[::-1]))
    return total / len(predicted)


def _points(depth: Tensor, row: Tensor, col: Tensor, shape: torch.Size, width: float) -> Tensor:
    """(n, 3) points of pixels in the sensor frame, in sensor widths."""
    x = (col.to(depth.dtype) + 0.5) / shape[1] - 0.5
    y = (row.to(depth.dtype) + 0.5) / shape[0] - 0.5
    return torch.stack([x, y, depth / width], dim=1)


def _check(predicted: Tensor, depth: Tensor, mask: Tensor, width: float, gel: float) -> None:
    if predicted.ndim != 3 or not (predicted.shape == depth.shape == mask.shape) or not len(predicted):
        shapes = ", ".join(str(tuple(tensor.shape)) for tensor in (predicted, depth, mask))
        raise ValueError(f"predicted, depth and mask have shapes {shapes}; all must be one (B, H, W) with B >= 1")
    if mask.dtype != torch.bool or not (predicted.is_floating_point() and depth.is_floating_point()):
        raise ValueError(f"predicted is {predicted.dtype}, depth {depth.dtype}, mask {mask.dtype}; they must be floating, floating, bool")
    check_full("predicted depth", predicted)
    if not (0 < width < math.inf and 0 < gel < math.inf):
        raise ValueError(f"sensor width {width} m, gel thickness {gel} m; both must be > 0 and finite")
    if bad := int((~torch.isfinite(predicted)).flatten(1).any(dim=1).sum()):
        raise ValueError(
            f"predicted depth holds infinity or NaN in {bad} of {len(predicted)} touches: the network has diverged; lower the learning rate"
        )
