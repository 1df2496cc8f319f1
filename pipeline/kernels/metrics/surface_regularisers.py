"""Losses that regularise a surface beside the Chamfer distance, differentiable in its vertices.

Vertices are (B, V, 3) floating, surfaces that share their faces. Terms are 0 at best, and their gradients are finite everywhere.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.geometry.mesh import directed_edges
from pipeline.kernels.tensor_checks import check_full_precision


def neighbouring_vertices(faces: NDArray[np.integer]) -> Tensor:
    """List the edges of faces (F, 3): (E, 2) int64, each once."""
    return torch.from_numpy(np.unique(np.sort(directed_edges(faces), axis=1), axis=0)).long()


def edge_length(vertices: Tensor, edges: Tensor) -> Tensor:
    """Compute the mean squared length of edges (E, 2), in the vertices' unit squared: (B,)."""
    check_full_precision("vertices", vertices)
    first, second = vertices[:, edges].unbind(dim=2)
    return (first - second).square().sum(dim=-1).mean(dim=-1)
