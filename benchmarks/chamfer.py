"""Measure the Chamfer distance of two clouds of 10,000 points and its gradient, beside all pairs and KeOps."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from benchmarks.cases import touched_objects
from benchmarks.timing import Table, side_by_side, single_call
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.metrics.chamfer import chamfer

POINTS = 10_000
OURS, KEOPS = "k-d tree, exact (ours)", "KeOps 2.3, all pairs, none stored"
Distance = Callable[[Tensor, Tensor], Tensor]


def measure(data: Path, turns: int) -> Table:
    """Measure two pairs of clouds of the dataset's first case, `turns` rounds of each method."""
    mesh = touched_objects(data)[0].mesh
    table = Table(
        f"Chamfer distance, {POINTS:,} × {POINTS:,}",
        ["one surface, ms", "÷ ours", "5 cm apart, ms", "÷ ours", "relative error, float32"],
        [
            "Forward and backward, float32, of two draws of exterior points of an object: on one surface, and one of them 5 cm aside. One "
            "thread, processor milliseconds, least / median; ratios of the least. Error: the worse of the two values against all pairs in "
            "float64.",
            "Every way is exact. Brute force and KeOps take as long whatever the clouds; a tree takes longer the farther they are apart. "
            "Times leave out that KeOps compiles its formula with g++ when first used, some ten seconds.",
        ],
    )
    methods: dict[str, Distance] = {OURS: chamfer, "torch.cdist, all pairs": all_pairs}
    with table.peer(KEOPS):
        methods[KEOPS] = load_keops()
    rng = np.random.default_rng(0)
    first, second = (torch.tensor(sample_exterior(mesh, POINTS, rng)[0], dtype=torch.float32) for _ in range(2))
    pairs = [(first, second), (first, second + torch.tensor([0.05, 0.0, 0.0]))]
    times = [
        side_by_side({name: single_call(lambda w=method, a=a, b=b: _step(w, a, b)) for name, method in methods.items()}, turns)
        for a, b in pairs
    ]
    for name, method in methods.items():
        error = max(abs(float(method(a, b)) / float(all_pairs(a.double(), b.double())) - 1) for a, b in pairs)
        table.add(name, *(cell for pair in times for cell in (pair[name], pair[name].over(pair[OURS]))), f"{error:.1e}")
    return table


def all_pairs(a: Tensor, b: Tensor) -> Tensor:
    """Compute the Chamfer distance from all distances at once."""
    pairs = torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist")
    return pairs.min(dim=1).values.square().mean() + pairs.min(dim=0).values.square().mean()


def _step(distance: Distance, a: Tensor, b: Tensor) -> None:
    distance(a.clone().requires_grad_(), b).backward()  # type: ignore[no-untyped-call]


def load_keops() -> Distance:
    """Make the Chamfer distance by KeOps; raises ImportError or RuntimeError where it is not installed or cannot compile."""
    if shutil.which("g++") is None:
        raise RuntimeError("KeOps compiles its formulas with g++, which is missing; on Debian: apt-get install g++")
    from pykeops.torch import LazyTensor

    def nearest(a: Tensor, b: Tensor) -> Tensor:
        pairs = LazyTensor(a.detach()[:, None, :].contiguous()) - LazyTensor(b.detach()[None, :, :].contiguous())
        index: Tensor = (pairs**2).sum(-1).argmin(dim=1).view(-1)
        return index

    return lambda a, b: (a - b[nearest(a, b)]).square().sum(1).mean() + (b - a[nearest(b, a)]).square().sum(1).mean()
