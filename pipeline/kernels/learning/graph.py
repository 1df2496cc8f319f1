"""The graph that vision and touch charts form, as the averages over neighbours that zero-neighbour layers take (supplement 3.1, 3.2).

Two vertices are neighbours where an edge of a chart joins them, where they are vision vertices that coincide, or where one is the
centre of a touch chart and the other the centre of a vision chart. Every vertex is a neighbour of its own.

A batch is one graph: item b has its V vision vertices, then its `counts[b]` touch charts of side · side vertices, then comes item b + 1.
Averages are products with a sparse matrix in compressed rows; a dense adjacency costs some 30 times more, index_add more still.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.learning.chart_sphere import ChartSphere
from pipeline.kernels.learning.chart_square import chart_square
from pipeline.kernels.learning.precision import FULL

INDICES = np.iinfo(np.int32).max
"""Pairs of neighbours that 32-bit indices reach."""
CACHED_PATTERNS = 64
"""Items of as many different numbers of touch charts are kept: about 0.3 MB each."""


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
    """

    mean: Tensor
    transposed: Tensor
    counts: tuple[int, ...]
    sizes: tuple[int, ...]
    vision: int

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
    sizes = [len(item.degree) for item in items]
    first = np.cumsum([0, *sizes])
    start = np.cumsum([0, *(len(item.neighbours) for item in items)])
    rows = np.concatenate([[0], *(item.rows[1:] + offset for item, offset in zip(items, start[:-1], strict=True))])
    if rows[-1] > INDICES:
        raise ValueError(f"{len(counts)} items have {rows[-1]} pairs of neighbours, a graph {INDICES} at most: take fewer items at once")
    neighbours = np.concatenate([item.neighbours + offset for item, offset in zip(items, first[:-1], strict=True)])
    weight = 1 / np.concatenate([item.degree for item in items])
    # The pattern is symmetric, so the transpose has the same one and only its values differ.
    forward, backward = (
        _compressed(rows, neighbours, values, device, dtype) for values in (np.repeat(weight, np.diff(rows)), weight[neighbours])
    )
    return ChartGraph(forward, backward, tuple(counts), tuple(sizes), len(sphere.vertices))


@dataclass(frozen=True, eq=False)
class _Item:
    """Compressed rows of one item's neighbourhoods: those of vertex i are neighbours[rows[i]:rows[i + 1]], degree[i] many."""

    rows: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    degree: NDArray[np.int64]


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
    return _Item(np.concatenate([[0], np.cumsum(degree)]), second, degree)


def _edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3 F, 2) the sides of faces (F, 3)."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _compressed(
    rows: NDArray[np.int64], columns: NDArray[np.int64], values: NDArray[np.float64], device: torch.device, dtype: torch.dtype
) -> Tensor:
    """A square sparse CSR tensor; indices are int32, which MKL and cuSPARSE take without converting them at every product."""
    size = len(rows) - 1
    with warnings.catch_warnings():  # it says that torch may change the interface; nothing about these numbers
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        return torch.sparse_csr_tensor(
            torch.from_numpy(rows.astype(np.int32)),
            torch.from_numpy(columns.astype(np.int32)),
            torch.from_numpy(values).to(dtype),
            (size, size),
            device=device,
            check_invariants=False,
        )
