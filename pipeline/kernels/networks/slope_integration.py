"""Surfaces from slopes, by Poisson's equation with sine transforms: pinned beyond the image's rim, or free where it is pressed."""

import math
from functools import lru_cache

import torch
from torch import Tensor

from pipeline.kernels.arrays import check_shape

PRESSED = 0.01  # mm, from which the rim counts as pressed: errors of slopes make 0.004 where it is at rest


def integrate_slopes(
    slopes: Tensor,  # (B, 2, H, W) dz/dx and dz/dy at the pixel centres; +x along columns, +y along rows
    pitch: tuple[float, float],  # size of a pixel along y and x, in the unit of the result
) -> Tensor:  # (B, H, W) z, of the slopes' type, differentiable; 0 one pixel beyond the image's rim
    """Compute the surface whose slopes are nearest, in the least-squares sense, to given ones.

    Between two pixels the surface rises by the mean of their slopes times the pitch. The normal equations of these differences are
    Poisson's equation on the grid, which sine transforms make diagonal; as matrix products, they cost less than fast transforms here.
    """
    check_shape("slopes", slopes, "B", 2, "H", "W")
    return _solve(_divergence(slopes[:, 0], -1) / pitch[1] + _divergence(slopes[:, 1], -2) / pitch[0], pitch)


def free_pressed_rim(
    depth: Tensor,  # (B, H, W) mm, of `integrate_slopes`
    slopes: Tensor,  # (B, 2, H, W)
    pitch: tuple[float, float],  # size of a pixel along y and x, mm
) -> Tensor:  # (B, H, W) mm; of images whose rim is at rest, `depth` itself
    """Compute the surface whose slopes are nearest to given ones when the rim is pinned only where the gel is at rest.

    A pin is the difference between a pixel of the rim and 0 beyond it. Those that hold the surface up against the slopes by `PRESSED` or
    more are released, and the surface sinks there; then further ones, until none holds so much. The rest balance: never are all released.
    The surface sinks as if the released pins pushed, so that only the pins' equations are solved again.
    """
    rows, cols = depth.shape[1:]
    sizes = depth.new_tensor([pitch[0]] * 2 * cols + [pitch[1]] * 2 * rows)
    outward = torch.cat([-slopes[:, 1, 0], slopes[:, 1, -1], -slopes[:, 0, :, 0], slopes[:, 0, :, -1]], dim=1)
    held = _rim(depth) + outward * sizes / 2  # (B, P) by each pin against the slopes
    push = torch.zeros_like(held)
    for k in (held > PRESSED).any(dim=1).nonzero()[:, 0].tolist():
        answer, now, released = _answer(rows, cols, pitch, depth.dtype, depth.device) / sizes**2, held[k], 0
        while int((now > PRESSED).sum()) > released:
            free = (now > PRESSED).nonzero()[:, 0]
            released, identity = len(free), torch.eye(len(free)).to(depth)
            sunk = torch.linalg.solve(identity - answer[free][:, free], held[k, free])
            now = held[k] + answer[:, free] @ sunk
            push[k, free] = sunk / sizes[free] ** 2
    pixels = _rim(torch.arange(rows * cols, device=depth.device).reshape(1, rows, cols))[0]  # of the pins
    pushed = torch.zeros_like(depth).flatten(1).index_add(1, pixels, push)
    return depth - _solve(pushed.view_as(depth), pitch) if push.any() else depth


def surface_slopes(depth: Tensor, pitch: tuple[float, float]) -> Tensor:
    """Compute (B, 2, H, W) slopes along x and y of (B, H, W) depth by central differences; `pitch` along y and x, in depth's unit."""
    down, across = torch.gradient(depth, spacing=(pitch[0], pitch[1]), dim=(1, 2))
    return torch.stack([across, down], dim=1)


def _solve(laplacian: Tensor, pitch: tuple[float, float]) -> Tensor:  # (B, H, W) each
    """Solve Poisson's equation for the surface that is 0 one pixel beyond the rim."""
    rows, cols = laplacian.shape[1:]
    (down, across), eigen = _modes(rows, cols, pitch, laplacian.dtype, laplacian.device)
    return down @ ((down @ laplacian @ across) / eigen) @ across


def _rim(surface: Tensor) -> Tensor:  # (B, H, W) to (B, P)
    """List the values at the pins: along the first and last row, then the first and last column. A corner has two."""
    return torch.cat([surface[:, 0], surface[:, -1], surface[:, :, 0], surface[:, :, -1]], dim=1)


@lru_cache(maxsize=4)
def _answer(rows: int, cols: int, pitch: tuple[float, float], dtype: torch.dtype, device: torch.device) -> Tensor:
    """Compute how far the surface sinks at each pin, (P, P), when it is pushed at each: Poisson's equation between pixels of the rim."""
    with torch.inference_mode(False):  # as below
        (down, across), eigen = _modes(rows, cols, pitch, dtype, device)
        top_bottom, left_right = down[[0, -1]], across[[0, -1]]
        between_rows = torch.einsum("sa,ta,ab,jb,kb->sjtk", top_bottom, top_bottom, 1 / eigen, across, across).reshape(2 * cols, 2 * cols)
        between_cols = torch.einsum("sb,tb,ab,ja,ka->sjtk", left_right, left_right, 1 / eigen, down, down).reshape(2 * rows, 2 * rows)
        along_rows, along_cols = left_right[:, None] * across, top_bottom[:, None] * down
        mixed = torch.einsum("sia,ab,tjb->sjti", along_cols, 1 / eigen, along_rows).reshape(2 * cols, 2 * rows)
        return -torch.cat([torch.cat([between_rows, mixed], dim=1), torch.cat([mixed.T, between_cols], dim=1)])


def _modes(
    rows: int, cols: int, pitch: tuple[float, float], dtype: torch.dtype, device: torch.device
) -> tuple[tuple[Tensor, Tensor], Tensor]:
    """Make the sine transforms along y and x, and the eigenvalues (rows, cols) of the second differences' sum."""
    (down, down_eigen), (across, across_eigen) = (_sines(count, dtype, device) for count in (rows, cols))
    return (down, across), down_eigen[:, None] / pitch[0] ** 2 + across_eigen[None] / pitch[1] ** 2


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
