"""Chamfer distance of 10,000 points and as many, with its gradient: beside all pairs and KeOps."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from benchmarks.chamfer import POINTS, all_pairs
from benchmarks.peers.cases import Case
from benchmarks.peers.table import Table
from benchmarks.timing import Round, each, side_by_side
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.metrics.chamfer import chamfer

APART = 0.05
"""m, between clouds that do not lie on each other: a prediction far from its target."""
OURS = "k-d tree, exact (ours)"
Distance = Callable[[Tensor, Tensor], Tensor]


def measure(cases: Sequence[Case], turns: int) -> Table:
    """The table; `turns` rounds of every way, of each pair of clouds."""
    table = Table(
        f"Chamfer distance, {POINTS:,} × {POINTS:,}",
        ["one surface, ms", "÷ ours", "5 cm apart, ms", "÷ ours", "relative error, float32"],
        [
            f"Forward and backward, float32, of two draws of exterior points of {cases[0].name}: on one surface, and one of them 5 cm "
            "aside. One thread, processor milliseconds, least / median; ratios of the least. Error: the worse of the two values "
            "against all pairs in float64.",
            "Every way is exact, with the same gradient. Brute force and KeOps take as long whatever the clouds; a tree takes longer the "
            "farther they are apart. On a GPU the order is another.",
            "KeOps compiles its formula with g++ when first used, some ten seconds, in no time here; its neighbours are found by it, the "
            "distances of pairs differentiated by torch, as with the tree.",
        ],
    )
    ways: dict[str, Distance] = {OURS: chamfer, "torch.cdist, all pairs": all_pairs}
    try:
        ways["KeOps 2.3, all pairs, none stored"] = load_keops()
    except (ImportError, RuntimeError) as error:
        table.could_not_run("KeOps 2.3, all pairs, none stored", error)
    rng = np.random.default_rng(0)
    first, second = (torch.tensor(sample_exterior(cases[0].mesh, POINTS, rng)[0], dtype=torch.float32) for _ in range(2))
    apart = second + torch.tensor([APART, 0.0, 0.0])
    pairs = [(first, second), (first, apart)]
    times = [side_by_side(_rounds(ways, *pair), turns) for pair in pairs]
    for name in times[0]:
        distance = ways.get(name, chamfer)
        error = max(abs(float(distance(a, b)) / float(all_pairs(a.double(), b.double())) - 1) for a, b in pairs)
        cells = [cell for one in times for cell in (str(one[name]), f"{one[name].least / one[OURS].least:.2f}")]
        table.add(name, *cells, f"{error:.1e}")
    return table


def _rounds(ways: dict[str, Distance], a: Tensor, b: Tensor) -> dict[str, Round]:
    return {name: each(lambda target, distance=distance: _step(distance, a, target), [b]) for name, distance in ways.items()}


def _step(distance: Callable[[Tensor, Tensor], Tensor], a: Tensor, b: Tensor) -> None:
    points = a.clone().requires_grad_()
    distance(points, b).backward()  # type: ignore[no-untyped-call]


def load_keops() -> Distance:
    """Chamfer distance by KeOps.

    Raises
    ------
    ImportError, RuntimeError
        It is not installed, or cannot compile here; the message says which.
    """
    if shutil.which("g++") is None:
        raise RuntimeError("KeOps compiles its formulas with g++, and there is none; on Debian: apt-get install g++")
    from pykeops.torch import LazyTensor

    def nearest(a: Tensor, b: Tensor) -> Tensor:
        pairs = LazyTensor(a.detach()[:, None, :].contiguous()) - LazyTensor(b.detach()[None, :, :].contiguous())
        index: Tensor = (pairs**2).sum(-1).argmin(dim=1).view(-1)
        return index

    def distance(a: Tensor, b: Tensor) -> Tensor:
        a_to_b, b_to_a = (a - b[nearest(a, b)]).square().sum(1), (b - a[nearest(b, a)]).square().sum(1)
        return a_to_b.mean() + b_to_a.mean()

    return distance
