"""Depth losses of empty, full and single-pixel masks at any scale."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from pipeline.kernels.networks.unet import masked_depth_loss, projected_chamfer_loss, visible_depth
from tests.references import exact_distances as exact
from tests.strategies import seeds

WIDTH, GEL = 2.0**-6, 2.0**-7
Loss = Callable[..., Tensor]
LOSSES: list[Loss] = [masked_depth_loss, projected_chamfer_loss]
CONTACTS = {
    "empty": lambda rng, shape: np.zeros(shape, bool),
    "full": lambda rng, shape: np.ones(shape, bool),
    "one pixel": lambda rng, shape: np.arange(math.prod(shape)).reshape(shape) % math.prod(shape[1:]) == 0,
    "a row": lambda rng, shape: np.arange(shape[1])[:, None] + np.zeros(shape) == shape[1] // 2,
    "some": lambda rng, shape: rng.random(shape) < 0.4,
}
DEPTHS = {
    "in the gel": lambda rng, shape: rng.uniform(0, GEL, shape),
    "nothing met": lambda rng, shape: np.full(shape, np.inf),
    "the plane": lambda rng, shape: np.zeros(shape),
    "around the gel's surface": lambda rng, shape: GEL * (1 + rng.choice([-1e-9, 0, 1e-9], shape)),
    "some of all": lambda rng, shape: rng.choice([0.0, 1e-12, GEL / 3, GEL, 0.05, 1e3, np.inf], shape),
}
BOUND = 1e-6, 3e-7
"""The docstring's: the root of a loss errs by so much of itself, and by so much of the width or of what is deeper."""


def scene(contact: str, truth: str, seed: int, far: float = 1.0) -> tuple[Tensor, Tensor, Tensor]:
    """Predicted and true depth, in float32, and the mask: (2, 4, 5) each."""
    rng, shape = np.random.default_rng(seed), (2, 4, 5)
    predicted = torch.from_numpy(rng.uniform(0, GEL * far, shape)).float()
    return predicted, torch.from_numpy(DEPTHS[truth](rng, shape)).float(), torch.from_numpy(CONTACTS[contact](rng, shape))


def root_of_exact(loss: Loss, predicted: Tensor, depth: Tensor, mask: Tensor) -> float:
    """Compute the square root of a loss in rational arithmetic."""
    total = Fraction(0)
    _, rows, cols = mask.shape
    for item in range(len(mask)):
        pixels = mask[item].nonzero().tolist()
        if not pixels:
            continue
        clouds = []
        for image in (predicted[item], depth[item].clamp(max=GEL)):
            values = image.double().numpy()
            places = [((c + 0.5) / cols - 0.5, (r + 0.5) / rows - 0.5, values[r, c] / WIDTH) for r, c in pixels]
            clouds.append(np.array(places))
        if loss is masked_depth_loss:
            total += exact.mean([(Fraction(a) - Fraction(b)) ** 2 for a, b in zip(clouds[0][:, 2], clouds[1][:, 2], strict=True)])
        else:
            total += sum(exact.mean(exact.nearest_squared(a, b)) for a, b in (clouds, clouds[::-1]))
    return math.sqrt(total / len(mask))


GIVEN = {
    "contact": st.sampled_from(sorted(CONTACTS)),
    "truth": st.sampled_from(sorted(DEPTHS)),
    "seed": seeds,
    "far": st.sampled_from([1e-6, 1.0, 1e3]),
}


@pytest.mark.parametrize("loss", LOSSES)
@given(**GIVEN)
def test_values_are_exact_and_gradients_finite(loss: Loss, contact: str, truth: str, seed: int, far: float) -> None:
    predicted, depth, mask = scene(contact, truth, seed, far)
    predicted.requires_grad_()
    value = loss(predicted, depth, mask, width=WIDTH, gel=GEL)
    (gradient,) = torch.autograd.grad(value, predicted)
    true = root_of_exact(loss, predicted.detach(), depth, mask)
    deepest = max(float(predicted.detach().max()) / WIDTH, 1.0)
    assert abs(math.sqrt(float(value.detach())) - true) <= BOUND[0] * true + BOUND[1] * deepest
    assert bool(torch.isfinite(gradient).all())
    assert bool((gradient[~mask] == 0).all())
    if contact == "empty":
        assert float(value.detach()) == 0


@pytest.mark.parametrize("loss", LOSSES)
@given(power=st.integers(-6, 6), **GIVEN)
def test_loss_does_not_depend_on_the_size_of_the_sensor(loss: Loss, power: int, contact: str, truth: str, seed: int, far: float) -> None:
    """Losses are in sensor widths: from a sensor of a quarter of a millimetre to one of a metre."""
    predicted, depth, mask = scene(contact, truth, seed, far)
    factor = 2.0**power
    here = loss(predicted, depth, mask, width=WIDTH, gel=GEL)
    there = loss(predicted * factor, depth * factor, mask, width=WIDTH * factor, gel=GEL * factor)
    assert float(here) == float(there)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("contact", sorted(CONTACTS))
def test_infinite_depth_counts_as_the_surface_of_the_gel(loss: Loss, contact: str) -> None:
    predicted, depth, mask = scene(contact, "nothing met", 0)
    assert float(loss(predicted, depth, mask, width=WIDTH, gel=GEL)) == float(
        loss(predicted, torch.full_like(depth, GEL), mask, width=WIDTH, gel=GEL)
    )


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"predicted": math.inf}, "infinity or NaN in 2 of 2"),
        ({"depth": -math.inf}, "-inf"),
    ],
)
def test_invalid_depths_are_rejected_even_without_masked_pixels(loss: Loss, changed: dict[str, float], message: str) -> None:
    predicted, depth, mask = scene("empty", "in the gel", 0)
    filled = [torch.full_like(tensor, changed.get(name, 0.001)) for name, tensor in (("predicted", predicted), ("depth", depth))]
    with pytest.raises(ValueError, match=message):
        loss(filled[0], filled[1], mask, width=WIDTH, gel=GEL)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_is_rejected(loss: Loss, dtype: torch.dtype) -> None:
    predicted, depth, mask = scene("full", "in the gel", 0)
    with pytest.raises(ValueError, match=f"predicted depth of type {dtype}"):
        loss(predicted.to(dtype), depth, mask, width=WIDTH, gel=GEL)


def test_visible_depth_keeps_its_type_and_rejects_nan() -> None:
    for dtype in (torch.float32, torch.float64):
        assert visible_depth(torch.tensor([0.0, 1e3, math.inf], dtype=dtype), 0.5).tolist() == [0, 0.5, 0.5]
    with pytest.raises(ValueError, match="NaN or -inf"):
        visible_depth(torch.tensor([math.nan]), 0.5)
