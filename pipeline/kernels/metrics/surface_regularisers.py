"""Losses that regularise a surface beside the Chamfer distance, differentiable in its vertices.

Vertices are (B, V, 3) floating, surfaces that share their faces. Terms are 0 at best, and their gradients are finite everywhere.
"""

from __future__ import annotations

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from pipeline.kernels.geometry.mesh import directed_edges
from pipeline.kernels.tensor_checks import check_full_precision

FLAT_AREA = 1e-12
"""Twice the area of a face, in the unit squared, below which its normal counts less and less."""


def neighbouring_vertices(faces: NDArray[np.integer]) -> Tensor:
    """List the edges of faces (F, 3): (E, 2) int64, each once."""
    return torch.from_numpy(np.unique(np.sort(directed_edges(faces), axis=1), axis=0)).long()


def neighbouring_faces(faces: NDArray[np.integer]) -> Tensor:
    """List the pairs of faces that share an edge, (E, 2) int64."""
    pairs = trimesh.graph.face_adjacency(faces)  # type: ignore[no-untyped-call]
    return torch.from_numpy(pairs).long()


def edge_length(vertices: Tensor, edges: Tensor) -> Tensor:
    """Compute the mean squared length of edges (E, 2), in the vertices' unit squared: (B,)."""
    check_full_precision("vertices", vertices)
    first, second = vertices[:, edges].unbind(dim=2)
    return (first - second).square().sum(dim=-1).mean(dim=-1)


def laplacian(displacements: Tensor, edges: Tensor) -> Tensor:
    """Compute how much displacements differ from those of their neighbours.

    Parameters
    ----------
    displacements
        (B, V, 3) how far each vertex has moved.
    edges
        (E, 2) int64, pairs of neighbours, each once.

    Returns
    -------
    (B,) the mean squared distance of a displacement to the mean of its neighbours', the unit squared; 0 where all move alike.
    """
    check_full_precision("displacements", displacements)
    both = torch.cat([edges, edges.flip(1)]).to(displacements.device)
    degree = torch.bincount(both[:, 0], minlength=displacements.shape[1]).clamp(min=1)[:, None]
    sums = torch.zeros_like(displacements).index_add(1, both[:, 0], displacements[:, both[:, 1]])
    alone = torch.bincount(both[:, 0], minlength=displacements.shape[1]) == 0  # such a vertex differs from no neighbour
    apart: Tensor = torch.where(alone[:, None], 0, displacements - sums / degree)
    return apart.square().sum(dim=-1).mean(dim=-1)


def bending(vertices: Tensor, faces: Tensor, pairs: Tensor) -> Tensor:
    """Compute how much neighbouring faces are bent against each other.

    Parameters
    ----------
    vertices
        (B, V, 3).
    faces
        (F, 3) int64.
    pairs
        (E, 2) int64, faces that share an edge, wound alike.

    Returns
    -------
    (B,) the mean of 1 - cos of the angle between their normals: 0 on a plane, 2 where all fold back.
    """
    check_full_precision("vertices", vertices)
    a, b, c = vertices[:, faces].unbind(dim=2)
    across = torch.linalg.cross(b - a, c - a)  # (B, F, 3)
    normals = across / (across.square().sum(dim=-1, keepdim=True) + FLAT_AREA**2).sqrt()
    first, second = normals[:, pairs].unbind(dim=2)
    bent: Tensor = 1 - (first * second).sum(dim=-1)
    return bent.mean(dim=-1)
