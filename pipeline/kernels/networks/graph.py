"""The graph that vision and touch charts form, as the averages over neighbours that zero-neighbour layers take (supplement 3.1, 3.2).

Two vertices are neighbours where an edge of a chart joins them, where they are vision vertices that coincide, or where one is the
centre of a touch chart and the other the centre of a vision chart. Every vertex is a neighbour of its own.

A batch is one graph: item b has its V vision vertices, then its `counts[b]` touch charts of side · side vertices, then comes item b + 1.
Averages are products with a sparse matrix in compressed rows; a dense adjacency costs some 30 times more, index_add more still.

Only vision vertices move, and a layer carries features one edge far. Of the last layer's touch vertices only centres matter to them, of
the one before only centres and their neighbours, and so on: the last layers have graphs of their own, without the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.charts.chart_sphere import ChartSphere
from pipeline.kernels.charts.chart_square import chart_square
from pipeline.kernels.metrics.precision import FULL
from pipeline.kernels.networks.block_diagonal import Rows, block_diagonal

CACHED_PATTERNS = 64
"""Items of as many different numbers of touch charts are kept: about 1 MB each."""
CUTS = 5
"""Last layers with a graph of their own: five edges from its centre, hardly a vertex of the supplement's touch chart is missing."""


@dataclass(frozen=True, eq=False)
class Cut:
    """What a layer takes where only some vertices matter after it: m of a graph's vertices go in, n of these come out.

    Attributes
    ----------
    mean
        (n, m) sparse CSR: averages over neighbours, as a graph's.
    transposed
        (m, n) sparse CSR.
    entering
        (m,) int64: the vertices that go in, of those of the graph.
    leaving
        (n,) int64: the vertices that come out, of those that go in.
    """

    mean: Tensor
    transposed: Tensor
    entering: Tensor
    leaving: Tensor


@dataclass(frozen=True, eq=False)
class ChartGraph:
    """Neighbourhoods of the N vertices of a batch of B items.

    Attributes
    ----------
    mean
        (N, N) sparse CSR: row i averages over the neighbours of vertex i, itself included; its values are 1 / their number.
    transposed
        (N, N) sparse CSR: the transpose of `mean`, for gradients.
    counts
        Touch charts of each item.
    sizes
        Vertices of each item: V + counts[b] · side · side.
    vision
        V, the vision vertices an item starts with.
    cuts
        Of the last layer, the one before, …: what comes out of the last are vision vertices. None where there is no touch chart.
    """

    mean: Tensor
    transposed: Tensor
    counts: tuple[int, ...]
    sizes: tuple[int, ...]
    vision: int
    cuts: tuple[Cut, ...]

    def join(self, vision: Tensor, touch: Tensor) -> Tensor:
        """(N, F) features in the graph's order from the vision vertices' (B, V, F) and the touch vertices' (N - B·V, F)."""
        expected = (len(self.counts), self.vision), sum(self.sizes) - len(self.counts) * self.vision
        if (tuple(vision.shape[:2]), touch.shape[0]) != expected:
            raise ValueError(
                f"vision {tuple(vision.shape)} and touch {tuple(touch.shape)} do not fit a graph of {expected[0]} and {expected[1]}"
            )
        if not len(touch):
            return vision.reshape(-1, vision.shape[-1])
        pieces = torch.split(touch, [size - self.vision for size in self.sizes])
        return torch.cat([part for pair in zip(vision.unbind(), pieces, strict=True) for part in pair])

    def of_vision(self, features: Tensor) -> Tensor:
        """(B, V, F) the vision vertices' part of features (N, F) in the graph's order."""
        return torch.stack([part[: self.vision] for part in torch.split(features, list(self.sizes))])


def batch_graph(sphere: ChartSphere, side: int, counts: Sequence[int], device: torch.device, dtype: torch.dtype) -> ChartGraph:
    """The graph of a batch whose item b has the vision charts of `sphere` and `counts[b]` touch charts of side · side vertices.

    Raises
    ------
    ValueError
        Where `counts` is empty or has a negative number, the batch is too large for 32-bit indices, or the type is half precision.
    """
    if not counts or min(counts) < 0:
        raise ValueError(f"counts is {list(counts)}, but a batch needs one item at least and 0 or more touch charts in each")
    if dtype not in FULL:
        raise ValueError(f"averages over neighbours in {dtype}: they are taken in float32 or float64; use autocast for half precision")
    items = [_item(sphere, side, count) for count in counts]
    sizes = [len(item.hops) for item in items]
    mean, transposed = (block_diagonal([getattr(item, name) for item in items], device, dtype) for name in ("mean", "transposed"))
    cuts = tuple(_cut([item.cuts[k] for item in items], sizes, device, dtype) for k in range(CUTS if any(counts) else 0))
    return ChartGraph(mean, transposed, tuple(counts), tuple(sizes), len(sphere.vertices), cuts)


@dataclass(frozen=True, eq=False)
class _ItemCut:
    """A `Cut` of one item."""

    mean: Rows
    transposed: Rows
    entering: NDArray[np.int64]
    leaving: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Item:
    """One item's averages, their transpose, how many edges each vertex is from a vision vertex (CUTS + 1 where farther), and cuts."""

    mean: Rows
    transposed: Rows
    hops: NDArray[np.int64]
    cuts: tuple[_ItemCut, ...]


def _cut(cuts: Sequence[_ItemCut], sizes: Sequence[int], device: torch.device, dtype: torch.dtype) -> Cut:
    """The cuts of a batch's items, which have so many vertices, as one."""
    mean, transposed = (block_diagonal([getattr(cut, name) for cut in cuts], device, dtype) for name in ("mean", "transposed"))
    before = np.cumsum([0, *sizes])
    entered = np.cumsum([0, *(len(cut.entering) for cut in cuts)])
    entering = np.concatenate([cut.entering + first for cut, first in zip(cuts, before[:-1], strict=True)])
    leaving = np.concatenate([cut.leaving + first for cut, first in zip(cuts, entered[:-1], strict=True)])
    return Cut(mean, transposed, torch.from_numpy(entering).to(device), torch.from_numpy(leaving).to(device))


@lru_cache(maxsize=CACHED_PATTERNS)
def _item(sphere: ChartSphere, side: int, count: int) -> _Item:
    square, square_faces = chart_square(side)
    vision, touch = len(sphere.vertices), len(square)
    firsts = vision + touch * np.arange(count)  # (count,) first vertex of each touch chart
    centres = np.stack(np.meshgrid(firsts + touch // 2, sphere.centres, indexing="ij"), axis=-1).reshape(-1, 2)
    touch_faces = (np.asarray(square_faces)[None] + firsts[:, None, None]).reshape(-1, 3)
    pairs = np.concatenate([_edges(sphere.faces), sphere.seams, _edges(touch_faces), centres])
    size = vision + count * touch
    loops = np.repeat(np.arange(size)[:, None], 2, axis=1)
    both = np.concatenate([pairs, pairs[:, ::-1], loops])
    first, second = np.divmod(np.unique(both[:, 0] * size + both[:, 1]), size)
    degree = np.bincount(first, minlength=size)
    starts = np.concatenate([[0], np.cumsum(degree)])
    # The pattern is symmetric, so the transpose has the same one and only its values differ.
    mean, transposed = Rows(starts, second, 1 / degree[first], size), Rows(starts, second, 1 / degree[second], size)
    hops = np.where(np.arange(size) < vision, 0, CUTS + 1)
    for k in range(CUTS):
        near = second[hops[first] == k]
        hops[near] = np.minimum(hops[near], k + 1)
    cuts = []
    for k in range(CUTS):
        out, into = hops <= k, hops <= k + 1
        places = np.flatnonzero(into)
        cuts.append(_ItemCut(mean.part(out, into), transposed.part(into, out), places, np.flatnonzero(out[places])))
    return _Item(mean, transposed, hops, tuple(cuts))


def _edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3 F, 2) the sides of faces (F, 3)."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
