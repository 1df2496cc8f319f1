"""Chamfer distance against rational arithmetic, at any scale and position."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from pipeline.kernels.metrics.chamfer import SearchCloud, chamfer, squared_distances
from tests.kernels.degenerate_clouds import CLOUDS, KINDS, OFFSETS, cloud
from tests.references import exact_distances as exact
from tests.strategies import scales, seeds

BOUND = {torch.float32: 1e-6, torch.float64: 1e-14}
"""Of itself, whatever the scale and the offset: what the docstring promises, and the same in float64."""
MILLIONTH_MORE = 1 + Fraction(1, 1_000_000)
TYPES = pytest.mark.parametrize("dtype", list(BOUND))


def pair(first: str, second: str, seed: int, scale: float, offset: np.ndarray, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Two clouds in one place."""
    clouds = (cloud(kind, seed + i, scale, offset) for i, kind in enumerate((first, second)))
    a, b = (torch.from_numpy(points).to(dtype) for points in clouds)
    return a, b


@TYPES
@given(first=KINDS, second=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_chamfer_equals_exact_arithmetic(dtype: torch.dtype, first: str, second: str, seed: int, scale: float, offset: np.ndarray) -> None:
    a, b = pair(first, second, seed, scale, offset, dtype)
    found, true = float(chamfer(a, b)), exact.chamfer(a.numpy(), b.numpy())
    assert abs(found - true) <= BOUND[dtype] * true
    each = np.array([float(squared) for squared in exact.nearest_squared(a.numpy(), b.numpy())])
    assert (np.abs(squared_distances(a, b).double().numpy() - each) <= BOUND[dtype] * each).all()


@given(kind=KINDS, seed=seeds, scale=scales, offset=OFFSETS, apart=OFFSETS)
def test_chamfer_of_clouds_far_apart(kind: str, seed: int, scale: float, offset: np.ndarray, apart: np.ndarray) -> None:
    a = torch.from_numpy(cloud(kind, seed, scale, offset)).float()
    b = torch.from_numpy(cloud("spread", seed, scale, apart)).float()
    true = exact.chamfer(a.numpy(), b.numpy())
    assert abs(float(chamfer(a, b)) - true) <= BOUND[torch.float32] * true


@TYPES
@given(kind=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_chamfer_of_a_cloud_with_itself_is_zero_with_zero_gradient(
    dtype: torch.dtype, kind: str, seed: int, scale: float, offset: np.ndarray
) -> None:
    points = torch.from_numpy(cloud(kind, seed, scale, offset)).to(dtype)
    a, b = points.clone().requires_grad_(), points.flip(0).requires_grad_()
    distance = chamfer(a, b)
    gradients = torch.autograd.grad(distance, (a, b))
    assert float(distance.detach()) == 0
    assert all(bool((gradient == 0).all()) for gradient in gradients)


@given(first=KINDS, second=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_gradients_in_float32_are_those_of_float64(first: str, second: str, seed: int, scale: float, offset: np.ndarray) -> None:
    a, b = (points.requires_grad_() for points in pair(first, second, seed, scale, offset, torch.float32))
    exactly = [points.detach().double().requires_grad_() for points in (a, b)]
    for found, true in zip(
        torch.autograd.grad(chamfer(a, b), (a, b)), torch.autograd.grad(chamfer(exactly[0], exactly[1]), exactly), strict=True
    ):
        assert bool(torch.isfinite(found).all())
        assert float((found - true).abs().max()) <= 1e-6 * float(true.abs().max())


@pytest.mark.parametrize(("apart", "error"), [(1e-3, 0.03), (3e-4, 0.3), (1e-4, 3.0)])
def test_squared_differences_stay_accurate_where_the_expanded_square_fails(apart: float, error: float) -> None:
    """The float32 form |a|² + |b|² - 2ab of other libraries errs by 3 % of a millimetre or more; differences by less than a millionth."""
    rng = np.random.default_rng(0)
    a = torch.from_numpy(rng.uniform(-0.25, 0.25, (60, 3)) + [0, 0, 0.6]).float()
    b = (a.double() + apart * torch.nn.functional.normalize(torch.from_numpy(rng.normal(size=(60, 3))))).float()
    true = torch.tensor([float(squared) for squared in exact.nearest_squared(a.numpy(), b.numpy())])
    expanded = (a.square().sum(1)[:, None] + b.square().sum(1)[None] - 2 * a @ b.T).min(dim=1).values

    def rms(found: Tensor) -> float:
        return float(((found - true) / true).square().mean().sqrt())

    assert rms(squared_distances(a, b)) < BOUND[torch.float32]
    assert rms(expanded) > error


@given(first=KINDS, second=KINDS, seed=seeds, scale=scales, offset=OFFSETS)
def test_all_pairs_search_finds_an_equally_near_point(first: str, second: str, seed: int, scale: float, offset: np.ndarray) -> None:
    """In float32 the search may choose another point, whose distance is within a millionth of the least."""
    a, b = pair(first, second, seed, scale, offset, torch.float32)
    target = SearchCloud(b)
    target._tree = None
    chosen = b[target.nearest(a)]
    for point, there, least in zip(a.numpy(), chosen.numpy(), exact.nearest_squared(a.numpy(), b.numpy()), strict=True):
        squared = exact.nearest_squared(point[None], there[None])[0]
        assert squared <= least * MILLIONTH_MORE


@TYPES
@pytest.mark.parametrize("kind", sorted(CLOUDS))
@pytest.mark.parametrize("power", [-10, -3, 6])
def test_chamfer_scales_exactly_with_doubled_lengths(dtype: torch.dtype, kind: str, power: int) -> None:
    a, b = pair(kind, "spread", 3, 1.0, np.array([0.0, 0, 0.6]), dtype)
    assert float(chamfer(a * 2.0**power, b * 2.0**power)) == 4.0**power * float(chamfer(a, b))


@given(kind=KINDS, seed=seeds, scale=scales, copies=st.integers(2, 5))
def test_chamfer_ignores_copies_of_a_cloud(kind: str, seed: int, scale: float, copies: int) -> None:
    a, b = pair(kind, "spread", seed, scale, np.zeros(3), torch.float64)
    many = a.repeat(copies, 1)
    torch.testing.assert_close(chamfer(many, b), chamfer(a, b), rtol=1e-13, atol=0)
    assert bool((squared_distances(a, many) == 0).all())
