"""The drift of a photograph: a smooth difference of light from the untouched photograph, without contact."""

from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from pipeline.kernels.touch.calibrated_shading import powers

SIDE = 40  # pixels per side to which changes are averaged: drift is smooth
DEGREE = 2  # degree of the polynomial in the position: the contacts of one sensor are too small to be taken for drift
SCALE = 4.0
"""Levels, the usual size of the drift: pixels that differ from it by much more, as in contacts, hardly count."""
ROUNDS = 12  # rounds of weighted least squares


def without_drift(change: Tensor) -> Tensor:
    """Subtract the drift from changes (B, 3, H, W), image minus untouched image, levels.

    The drift is a polynomial of the position, fitted to the pixels without contact by iteratively reweighted least
    squares from a drift of 0: a pixel r levels away weighs 1 / (1 + (r / SCALE)²)².
    """
    levels = interpolate(change, size=(SIDE, SIDE), mode="area").flatten(2).transpose(1, 2)  # (B, n, 3)
    terms = _terms(SIDE, SIDE, change.dtype, change.device)  # (n, k)
    drift = torch.zeros_like(levels)
    for _ in range(ROUNDS):
        weight = (1 + (levels - drift).square().sum(dim=2) / SCALE**2) ** -2  # (B, n)
        weighted = weight[:, :, None] * terms
        ridge = torch.eye(terms.shape[1], dtype=change.dtype, device=change.device)  # weighs as one pixel: if all are pressed, none counts
        coefficients = torch.linalg.solve(weighted.transpose(1, 2) @ terms + ridge, weighted.transpose(1, 2) @ levels)  # (B, k, 3)
        drift = terms @ coefficients
    rows, cols = change.shape[2:]
    fitted: Tensor = _terms(rows, cols, change.dtype, change.device) @ coefficients
    return change - fitted.transpose(1, 2).reshape(change.shape)


@lru_cache(maxsize=8)
def _terms(rows: int, cols: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Make the terms of the polynomial at every pixel, (rows * cols, k)."""
    with torch.inference_mode(False):  # they are cached, and a training may follow in this process
        y, x = (2 * (torch.arange(count, dtype=dtype, device=device) + 0.5) / count - 1 for count in (rows, cols))
        return torch.stack([(x[None] ** i * y[:, None] ** j).flatten() for i, j in powers(DEGREE)], dim=1)
