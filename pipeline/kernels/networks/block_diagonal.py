"""Sparse matrices of a batch: those of its items along the diagonal, in compressed rows."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

INDICES = np.iinfo(np.int32).max
"""Entries that 32-bit indices reach."""


@dataclass(frozen=True, eq=False)
class Rows:
    """A sparse matrix (n, `width`) in compressed rows: row i has `values` at `columns`, both from starts[i] to starts[i + 1]."""

    starts: NDArray[np.int64]
    columns: NDArray[np.int64]
    values: NDArray[np.float64]
    width: int

    def part(self, rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> Rows:
        """The matrix of these rows (n,) and columns (width,) alone."""
        kept = np.repeat(rows, np.diff(self.starts)) & columns[self.columns]
        owner = np.repeat(np.arange(len(rows)), np.diff(self.starts))[kept]
        count = np.bincount(owner, minlength=len(rows))[rows]
        number = np.cumsum(columns) - 1
        return Rows(np.concatenate([[0], np.cumsum(count)]), number[self.columns[kept]], self.values[kept], int(columns.sum()))


def block_diagonal(blocks: Sequence[Rows], device: torch.device, dtype: torch.dtype) -> Tensor:
    """A sparse CSR tensor with the blocks along its diagonal.

    Indices are int32, which MKL and cuSPARSE take without converting them at every product. A `ValueError` where they do not reach.
    """
    entries = np.cumsum([0, *(len(block.columns) for block in blocks)])
    if entries[-1] > INDICES:
        raise ValueError(f"{len(blocks)} items have {entries[-1]} pairs of neighbours, a graph {INDICES} at most: take fewer items at once")
    widths = np.cumsum([0, *(block.width for block in blocks)])
    starts = np.concatenate([[0], *(block.starts[1:] + offset for block, offset in zip(blocks, entries[:-1], strict=True))])
    columns = np.concatenate([block.columns + offset for block, offset in zip(blocks, widths[:-1], strict=True)])
    with warnings.catch_warnings():  # it says that torch may change the interface; nothing about these numbers
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        return torch.sparse_csr_tensor(
            torch.from_numpy(starts.astype(np.int32)),
            torch.from_numpy(columns.astype(np.int32)),
            torch.from_numpy(np.concatenate([block.values for block in blocks])).to(dtype),
            (len(starts) - 1, int(widths[-1])),
            device=device,
            check_invariants=False,
        )
