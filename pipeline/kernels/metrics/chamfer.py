"""Chamfer distance between point clouds, differentiable: exact nearest neighbours, and gradients through the distances alone.

Clouds are finite, (N, 3), N >= 1, float32 or float64, in any unit. A squared distance between points as they are stored errs in float32 by
less than 1e-6 of itself, for sizes from 1e-6 to 1e6. The gradient is that of the distances with the neighbours held fixed: the true one
wherever the nearest is unique, and zero where points coincide.
"""

import scipy
import torch
from torch import Tensor

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import check_shape
from pipeline.kernels.tensors import check_full_precision

PAIRS_PER_BLOCK = 1 << 25  # distances a GPU holds at a time: 128 MiB of float32, as much again while they are summed


class SearchCloud:
    """A cloud (M, 3) with its search tree, a float64 k-d tree, for many comparisons; on a GPU all pairs are compared."""

    def __init__(self, points: Tensor) -> None:
        _check("points", points)
        self.points = points
        self._tree = scipy.spatial.cKDTree(points.detach().double().numpy(), balanced_tree=False) if points.device.type == "cpu" else None

    def nearest(self, query: Tensor) -> Tensor:
        """Find the nearest point to each of `query` (N, 3): (N,) int64 indices, without gradient; of equally near points any."""
        _check("query", query)
        if self._tree is not None:
            return torch.from_numpy(self._tree.query(query.detach().double().numpy(), workers=1)[1])
        return nearest_of_pairs(query, self.points)


def squared_distances(query: Tensor, points: Tensor | SearchCloud) -> Tensor:  # (N,) the unit squared
    """Compute the squared distance from each of `query` (N, 3) to the nearest of `points` (M, 3), differentiable in both clouds."""
    target = points if isinstance(points, SearchCloud) else SearchCloud(points)
    nearest = target.points.index_select(0, target.nearest(query))
    return (query - nearest).square().sum(dim=1)


def chamfer(a: Tensor, b: Tensor) -> Tensor:  # a scalar, the unit squared
    """Compute the Chamfer distance of two clouds: the mean squared nearest distance, both directions summed; differentiable.

    Two area-uniform draws of n points from one surface of area A are on average 2A / (π n) apart: no fit of samples gets below that.
    """
    return squared_distances(a, b).mean() + squared_distances(b, a).mean()


def nearest_of_pairs(
    query: Tensor,  # (..., N, 3), one cloud or a batch of them
    points: Tensor,  # (..., M, 3), M at least 1
    among: Tensor | None = None,  # (..., M) bool: the points that count; None for all
) -> Tensor:  # (..., N) int64 indices, without gradient
    """Find the nearest points by comparing all pairs, a block at a time; give any index where no point counts."""
    nearest = []
    with torch.no_grad():
        for block in torch.split(query, max(1, PAIRS_PER_BLOCK // points[..., 0].numel()), dim=-2):
            squared = _squared_differences(block, points)
            if among is not None:
                squared.masked_fill_(~among[..., None, :], torch.inf)
            nearest.append(squared.argmin(dim=-1))
    return torch.cat(nearest, dim=-1)


def _squared_differences(query: Tensor, points: Tensor) -> Tensor:  # (..., N, M)
    """Compute squared distances by coordinates: |a|² + |b|² - 2ab would lose all digits, torch.cdist took 30 of a step's 50 ms."""
    squared = (query[..., :, None, 0] - points[..., None, :, 0]).square_()
    for axis in (1, 2):
        squared += (query[..., :, None, axis] - points[..., None, :, axis]).square_()
    return squared


def _check(name: str, points: Tensor) -> None:
    check_shape(name, points, "N", 3)
    check_full_precision(name, points)
    if len(points) == 0:
        raise InvalidInput(f"{name} holds no points, (0, 3); a nearest point needs at least one: leave empty clouds out beforehand")
    finite = torch.isfinite(points.detach()).all(dim=1)
    if not bool(finite.all()):
        raise InvalidInput(f"{name} holds NaN or infinity in {int((~finite).sum())} of {len(points)} points; leave those out beforehand")
