"""Depth from slopes: Poisson's equation by sine transforms, differentiable."""

import math
from functools import lru_cache

import torch
from torch import Tensor


def integrate_slopes(
    slopes: Tensor,  # (B, 2, H, W) dz/dx and dz/dy at the pixel centres; +x along columns, +y along rows
    pitch: tuple[float, float],  # size of a pixel along y and x, in the unit of the result
) -> Tensor:  # (B, H, W) z, of the slopes' type, differentiable; 0 one pixel beyond the image's rim
    """Compute the surface whose slopes are nearest, in the least-squares sense, to given ones.

    Between two pixels the surface rises by the mean of their slopes times the pitch. The normal equations of these differences are
    Poisson's equation on the grid, which sine transforms make diagonal; these are products with matrices of at most a few hundred rows,
    which cost less than fast transforms of both axes would.
    """
    if slopes.ndim != 4 or slopes.shape[1] != 2:
        raise ValueError(f"slopes have shape {tuple(slopes.shape)}; they must be (B, 2, H, W)")
    rows, cols = slopes.shape[2:]
    (down, down_eigen), (across, across_eigen) = (_sines(count, slopes.dtype, slopes.device) for count in (rows, cols))
    divergence = _divergence(slopes[:, 0], -1) / pitch[1] + _divergence(slopes[:, 1], -2) / pitch[0]
    eigen = down_eigen[:, None] / pitch[0] ** 2 + across_eigen[None] / pitch[1] ** 2
    return down @ ((down @ divergence @ across) / eigen) @ across


def surface_slopes(depth: Tensor, pitch: tuple[float, float]) -> Tensor:
    """Compute (B, 2, H, W) slopes along x and y of (B, H, W) depth by central differences; `pitch` along y and x, in depth's unit."""
    down, across = torch.gradient(depth, spacing=(pitch[0], pitch[1]), dim=(1, 2))
    return torch.stack([across, down], dim=1)


def _divergence(slope: Tensor, axis: int) -> Tensor:
    """Difference, along an axis, of the slopes half a pixel after and before each pixel; beyond the rim slopes are 0."""
    count = slope.shape[axis]
    nothing = torch.zeros_like(slope.narrow(axis, 0, 1))
    padded = torch.cat([nothing, slope, nothing], dim=axis)
    return (padded.narrow(axis, 2, count) - padded.narrow(axis, 0, count)) / 2


@lru_cache(maxsize=16)
def _sines(count: int, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """Make the sine transform of a length, (n, n), its own inverse, and the eigenvalues of second differences."""
    with torch.inference_mode(False):  # they are cached, and a training may follow in this process
        numbers = torch.arange(1, count + 1, dtype=torch.float64)
        angles = math.pi * torch.outer(numbers, numbers) / (count + 1)
        eigen = 2 * torch.cos(math.pi * numbers / (count + 1)) - 2
        return (math.sqrt(2 / (count + 1)) * torch.sin(angles)).to(device, dtype), eigen.to(device, dtype)
