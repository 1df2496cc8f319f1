"""Losses that regularise a surface beside the Chamfer distance, differentiable in its vertices.

Vertices are (B, V, 3) floating, surfaces that share their faces. Terms are 0 at best, and their gradients are finite everywhere.
"""

from torch import Tensor

from pipeline.kernels.tensor_checks import check_full_precision


def edge_length(vertices: Tensor, edges: Tensor) -> Tensor:
    """Compute the mean squared length of edges (E, 2), in the vertices' unit squared: (B,)."""
    check_full_precision("vertices", vertices)
    first, second = vertices[:, edges].unbind(dim=2)
    return (first - second).square().sum(dim=-1).mean(dim=-1)
