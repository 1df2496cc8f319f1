"""Chamfer distance against float64 brute force, and at its extremes."""

import numpy as np
import pytest
import torch
from torch import Tensor

from pipeline.kernels.metrics import chamfer as chamfer_module
from pipeline.kernels.metrics.chamfer import SearchCloud, chamfer, squared_distances


def cloud(count: int, seed: int, scale: float = 0.25, dtype: torch.dtype = torch.float64) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    return (scale * points / points.norm(dim=1, keepdim=True) + torch.tensor([0.0, 0.0, 0.6])).to(dtype)


def brute(a: Tensor, b: Tensor) -> Tensor:
    """Compute the definition: all pairs, the least of each row and column."""
    pairs = ((a[:, None, :] - b[None, :, :]) ** 2).sum(-1)
    return pairs.min(dim=1).values.mean() + pairs.min(dim=0).values.mean()


def gradients(distance: Tensor, *clouds: Tensor) -> list[Tensor]:
    return list(torch.autograd.grad(distance, clouds))


@pytest.mark.parametrize(("count", "other"), [(1, 1), (1, 7), (300, 1), (1000, 700)])
def test_chamfer_and_gradients_equal_brute_force(count: int, other: int) -> None:
    a, b = cloud(count, 1).requires_grad_(), cloud(other, 2).requires_grad_()
    fast, slow = chamfer(a, b), brute(a, b)
    torch.testing.assert_close(fast, slow, rtol=1e-13, atol=0)
    for mine, theirs in zip(gradients(fast, a, b), gradients(slow, a, b), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-12, atol=1e-18)


def test_chamfer_gradient_equals_the_numerical_one() -> None:
    a, b = cloud(9, 3).requires_grad_(), cloud(6, 4).requires_grad_()
    assert torch.autograd.gradcheck(chamfer, (a, b))
    assert torch.autograd.gradcheck(squared_distances, (a, b))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gpu_agrees_with_cpu(dtype: torch.dtype) -> None:
    clouds = cloud(10_000, 12, dtype=dtype), cloud(10_000, 13, dtype=dtype)
    here = [points.requires_grad_() for points in clouds]
    there = [points.detach().cuda().requires_grad_() for points in clouds]
    torch.testing.assert_close(chamfer(*there).cpu(), chamfer(*here), rtol=1e-5, atol=0)
    for mine, theirs in zip(gradients(chamfer(*there), *there), gradients(chamfer(*here), *here), strict=True):
        torch.testing.assert_close(mine.cpu(), theirs, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (torch.zeros(0, 3), "no points"),
        (torch.zeros(4, 2), r"shape \(4, 2\)"),
        (torch.zeros(1, 4, 3), r"shape \(1, 4, 3\)"),
        (torch.zeros(4, 3, dtype=torch.int64), "int64"),
        (torch.zeros(4, 3, dtype=torch.bfloat16), "bfloat16"),
        (torch.zeros(4, 3, dtype=torch.float16), "float16"),
        (torch.tensor([[0.0, 0, np.nan], [0, 0, 0]]), "1 of 2 points"),
        (torch.tensor([[0.0, 0, np.inf]]), "infinity"),
    ],
)
def test_invalid_clouds_are_rejected_by_name(points: Tensor, message: str) -> None:
    good = torch.zeros(5, 3)
    for call in (
        lambda: chamfer(points, good),
        lambda: chamfer(good, points),
        lambda: squared_distances(points, good),
        lambda: SearchCloud(points).nearest(good),
    ):
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize("pairs", [chamfer_module.PAIRS_PER_BLOCK, 16 * 40])
def test_tree_and_pairwise_search_find_equally_near_points(pairs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chamfer_module, "PAIRS_PER_BLOCK", pairs)  # all at once, and in blocks of 16 queries
    draw = np.random.default_rng(1)
    points, queries = (torch.from_numpy(draw.normal(size=(count, 3))) for count in (40, 70))
    nearest = SearchCloud(points).nearest(queries), chamfer_module.nearest_of_pairs(queries, points)
    torch.testing.assert_close(*((queries - points[found]).norm(dim=1) for found in nearest))
