"""Chamfer distance, forward and backward, beside torch.cdist in one run. `python -m benchmarks.chamfer`."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from pipeline.kernels.metrics.chamfer import Target, chamfer

SECONDS = 1.0
"""How long each figure is measured."""
POINTS = 10_000
RADIUS = 0.25
"""m, of the sphere that the points lie on: an object's size."""


def cloud(seed: int, offset: float, dtype: torch.dtype, device: str) -> Tensor:
    """(POINTS, 3) on a sphere, moved by `offset` m."""
    directions = torch.randn(POINTS, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return (RADIUS * directions / directions.norm(dim=1, keepdim=True) + offset).to(device, dtype)


def all_pairs(a: Tensor, b: Tensor) -> Tensor:
    """Chamfer distance from all distances at once."""
    pairs = torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist")
    return pairs.min(dim=1).values.square().mean() + pairs.min(dim=0).values.square().mean()


def timed(distance: Callable[[Tensor], Tensor], a: Tensor) -> tuple[float, float]:
    """Median milliseconds of a call, and of a call with its gradient."""
    both: list[float] = []
    for backward in (False, True):
        times: list[float] = []
        stop = time.perf_counter() + SECONDS
        while time.perf_counter() < stop or len(times) < 3:
            points = a.clone().requires_grad_(backward)
            start = time.perf_counter()
            value = distance(points)
            if backward:
                value.backward()  # type: ignore[no-untyped-call]
            value.item()
            times.append((time.perf_counter() - start) * 1e3)
        both.append(float(np.median(times)))
    return both[0], both[1]


def row(name: str, offset: float, dtype: torch.dtype, device: str) -> str:
    """Measure one pair of clouds; a line of the table."""
    a, b = cloud(0, 0.0, dtype, device), cloud(1, offset, dtype, device)
    target = Target(b)
    exact = float(all_pairs(a.double().cpu(), b.double().cpu()))
    pairs = timed(lambda points: all_pairs(points, b), a)
    ours = timed(lambda points: chamfer(points, b), a)
    kept = timed(lambda points: chamfer(points, target), a)
    error = abs(float(chamfer(a, b)) - exact) / exact
    cells = "  ".join(f"{forward:7.1f} {backward:7.1f}" for forward, backward in (pairs, ours, kept))
    return f"{name:<22} {cells}  {pairs[1] / ours[1]:6.1f} x  {error:8.1e}"


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    print(f"Chamfer of {POINTS} x {POINTS} points, one thread: median ms forward, and forward + backward.")
    print(f"{'':<22} {'torch.cdist':>15}  {'chamfer':>15}  {'kept tree':>15}  {'cdist /':>8}  {'error':>8}")
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        for dtype in (torch.float32, torch.float64):
            for apart, offset in (("same place", 0.0), ("5 cm apart", 0.05)):
                print(row(f"{device} {str(dtype).removeprefix('torch.')} {apart}", offset, dtype, device), flush=True)


if __name__ == "__main__":
    main()
