"""`python -m benchmarks.chamfer`: Chamfer distance, forward and backward, beside torch.cdist."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from benchmarks.timing import alone, side_by_side
from pipeline.kernels.metrics.chamfer import chamfer

TURNS = 5
POINTS = 10_000
RADIUS = 0.25
"""m, of the sphere that the points lie on: an object's size."""
Distance = Callable[[Tensor], Tensor]


def cloud(seed: int, offset: float, dtype: torch.dtype, device: str) -> Tensor:
    """(POINTS, 3) on a sphere, moved by `offset` m."""
    directions = torch.randn(POINTS, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return (RADIUS * directions / directions.norm(dim=1, keepdim=True) + offset).to(device, dtype)


def all_pairs(a: Tensor, b: Tensor) -> Tensor:
    """Chamfer distance from all distances at once."""
    pairs = torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist")
    return pairs.min(dim=1).values.square().mean() + pairs.min(dim=0).values.square().mean()


def forward(distance: Distance, points: Tensor) -> None:
    distance(points).item()


def forward_backward(distance: Distance, points: Tensor) -> None:
    value = distance(points.clone().requires_grad_())
    value.backward()  # type: ignore[no-untyped-call]
    value.item()


def row(name: str, offset: float, dtype: torch.dtype, device: str) -> str:
    """Measure one pair of clouds; a line of the table."""
    a, b = cloud(0, 0.0, dtype, device), cloud(1, offset, dtype, device)
    exact = float(all_pairs(a.double().cpu(), b.double().cpu()))
    ways: list[Distance] = [lambda points: all_pairs(points, b), lambda points: chamfer(points, b)]
    rounds = {(k, call): alone(partial(call, way, a)) for k, way in enumerate(ways) for call in (forward, forward_backward)}
    times = [one.median for one in side_by_side(rounds, TURNS).values()]
    error = abs(float(chamfer(a, b)) - exact) / exact
    cells = "  ".join(f"{once:7.1f} {both:7.1f}" for once, both in zip(times[::2], times[1::2], strict=True))
    return f"{name:<22} {cells}  {times[1] / times[3]:6.1f} x  {error:8.1e}"


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    print(f"Chamfer of {POINTS} x {POINTS} points, one thread: median ms forward, and forward + backward.")
    print(f"{'':<22} {'torch.cdist':>15}  {'chamfer':>15}  {'cdist /':>8}  {'error':>8}")
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        for dtype in (torch.float32, torch.float64):
            for apart, offset in (("same place", 0.0), ("5 cm apart", 0.05)):
                print(row(f"{device} {str(dtype).removeprefix('torch.')} {apart}", offset, dtype, device), flush=True)


if __name__ == "__main__":
    main()
