"""The losses of a depth map against slow twins, closed forms and finite differences."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from pipeline.kernels.networks.unet import masked_depth_loss, projected_chamfer_loss, visible_depth

WIDTH, GEL = 0.01641, 0.0068
Loss = Callable[..., Tensor]
LOSSES: list[Loss] = [masked_depth_loss, projected_chamfer_loss]


def scene(batch: int = 3, rows: int = 6, cols: int = 5, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Predicted and true depth, partly beyond the gel and +inf, and a mask; float64."""
    rng = np.random.default_rng(seed)
    predicted = rng.uniform(0, GEL, (batch, rows, cols))
    depth = rng.uniform(0, 1.3 * GEL, (batch, rows, cols))
    depth[rng.random(depth.shape) < 0.2] = np.inf
    mask = rng.random(depth.shape) < 0.6
    return torch.from_numpy(predicted), torch.from_numpy(depth), torch.from_numpy(mask)


def slow_depth_loss(predicted: Tensor, depth: Tensor, mask: Tensor) -> float:
    losses = []
    for item in range(len(predicted)):
        squares = []
        for row, col in np.ndindex(tuple(mask.shape[1:])):
            if mask[item, row, col]:
                target = min(float(depth[item, row, col]), GEL)
                squares.append(((float(predicted[item, row, col]) - target) / WIDTH) ** 2)
        losses.append(sum(squares) / len(squares) if squares else 0.0)
    return sum(losses) / len(losses)


def slow_chamfer_loss(predicted: Tensor, depth: Tensor, mask: Tensor, aspect: float = 1.0) -> float:
    rows, cols = mask.shape[1:]
    losses = []
    for item in range(len(predicted)):
        clouds: tuple[list[tuple[float, ...]], list[tuple[float, ...]]] = ([], [])
        for row, col in np.ndindex(rows, cols):
            if mask[item, row, col]:
                x, y = (col + 0.5) / cols - 0.5, aspect * ((row + 0.5) / rows - 0.5)
                clouds[0].append((x, y, float(predicted[item, row, col]) / WIDTH))
                clouds[1].append((x, y, min(float(depth[item, row, col]), GEL) / WIDTH))
        loss = 0.0
        for a, b in (clouds, clouds[::-1]):
            nearest = [min(math.dist(p, q) ** 2 for q in b) for p in a]
            loss += sum(nearest) / len(nearest) if nearest else 0.0
        losses.append(loss)
    return sum(losses) / len(losses)


@pytest.mark.parametrize("seed", range(4))
def test_losses_equal_their_slow_twins(seed: int) -> None:
    given = scene(seed=seed)
    assert float(masked_depth_loss(*given, width=WIDTH, gel=GEL)) == pytest.approx(slow_depth_loss(*given), rel=1e-12)
    assert float(projected_chamfer_loss(*given, width=WIDTH, gel=GEL)) == pytest.approx(slow_chamfer_loss(*given), rel=1e-12)
    oblong = float(projected_chamfer_loss(*given, width=WIDTH, gel=GEL, aspect=1.5))
    assert oblong == pytest.approx(slow_chamfer_loss(*given, aspect=1.5), rel=1e-12)


@pytest.mark.parametrize("loss", LOSSES)
def test_loss_gradients_are_the_numerical_ones(loss: Loss) -> None:
    predicted, depth, mask = scene(2, 4, 4)
    assert torch.autograd.gradcheck(
        lambda value: loss(value, depth, mask, width=WIDTH, gel=GEL),
        (predicted.requires_grad_(),),
        eps=1e-8,
        atol=1e-6,
    )


@pytest.mark.parametrize("loss", LOSSES)
def test_empty_mask_has_zero_loss_and_gradient(loss: Loss) -> None:
    predicted, depth, mask = scene()
    predicted.requires_grad_()
    value = loss(predicted, depth, torch.zeros_like(mask), width=WIDTH, gel=GEL)
    value.backward()
    assert float(value.detach()) == 0.0
    assert predicted.grad is not None
    assert (predicted.grad == 0).all()
    mask[1] = False  # one of three
    predicted.grad = None
    loss(predicted, depth, mask, width=WIDTH, gel=GEL).backward()
    assert (predicted.grad[1] == 0).all()
    assert torch.isfinite(predicted.grad).all()
    assert (predicted.grad[0] != 0).any()


def test_visible_depth_is_clamped_to_the_gel() -> None:
    depth = torch.tensor([0.0, 0.001, GEL, 0.01, math.inf], dtype=torch.float64)
    assert visible_depth(depth, GEL).tolist() == [0.0, 0.001, GEL, GEL, GEL]
    curved = torch.tensor([GEL, GEL / 2, GEL / 2, GEL / 4, GEL / 4], dtype=torch.float64)  # its height at each pixel
    assert visible_depth(depth.expand(2, 5), curved).tolist() == [[0.0, 0.001, GEL / 2, GEL / 4, GEL / 4]] * 2


PREDICTED, DEPTH, MASK = scene()
BAD = torch.full_like(DEPTH, torch.nan)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((PREDICTED, BAD, MASK), "depth"),
        ((PREDICTED, -math.inf * DEPTH, torch.zeros_like(MASK)), "-inf"),
        ((BAD, DEPTH, MASK), "3 of 3"),
        ((PREDICTED + math.inf, DEPTH, torch.zeros_like(MASK)), "3 of 3"),
    ],
)
def test_invalid_inputs_are_rejected(loss: Loss, arguments: tuple[Tensor, Tensor, Tensor], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        loss(*arguments, width=WIDTH, gel=GEL)
