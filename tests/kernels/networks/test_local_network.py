"""The network that reads photographs: slopes, and the drift of light that is subtracted."""

import numpy as np
import pytest
import torch

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.local_network import (
    HIDDEN,
    ROUNDS,
    SCALE,
    SIDE,
    LocalNetwork,
    LocalShape,
    local_loss,
    pixel_positions,
    without_drift,
)
from pipeline.kernels.networks.slope_integration import integrate_slopes, surface_slopes

PITCH = (0.12, 0.1)


@pytest.fixture(scope="module")
def network() -> LocalNetwork:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return LocalNetwork(8).eval()


@pytest.fixture(scope="module")
def change() -> torch.Tensor:
    return 40 * torch.randn(1, 3, 24, 30, generator=torch.Generator().manual_seed(1))


def test_slopes_depend_on_three_pixels_around_only(network: LocalNetwork, change: torch.Tensor) -> None:
    given = change.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(network(given, pixel_positions(24, 30), (1.0, 1.0)).slopes[0, 0, 12, 15], given)
    row, col = gradient[0].abs().sum(dim=0).nonzero(as_tuple=True)
    assert (row.min(), row.max(), col.min(), col.max()) == (9, 15, 12, 18)


def test_depth_is_the_integral_of_slopes(network: LocalNetwork, change: torch.Tensor) -> None:
    shape = network(change, pixel_positions(24, 30), PITCH)
    torch.testing.assert_close(shape.depth, integrate_slopes(shape.slopes, PITCH))


def test_loss_is_minimal_at_the_truth_and_grows_with_each_error() -> None:
    depth = torch.zeros(1, 12, 12)
    depth[:, 4:8, 4:8] = 0.1
    truth = depth, depth > 0
    right = LocalShape(surface_slopes(depth, PITCH), depth)
    least = float(local_loss(right, *truth, PITCH))
    assert least < 1e-6
    for wrong in (
        right._replace(slopes=right.slopes + 0.1),
        right._replace(depth=right.depth + 0.05),
    ):
        assert float(local_loss(wrong, *truth, PITCH)) > least + 1e-3


def test_diverged_network_is_refused() -> None:
    nothing = torch.zeros(1, 8, 8)
    shape = LocalShape(torch.full((1, 2, 8, 8), torch.nan), nothing)
    with pytest.raises(InvalidInput, match="it has diverged"):
        local_loss(shape, nothing, nothing > 0, PITCH)


def positions(rows: int, cols: int) -> tuple[np.ndarray, np.ndarray]:
    y, x = (2 * (np.arange(count) + 0.5) / count - 1 for count in (rows, cols))
    return np.meshgrid(x, y)


def contact(rows: int = 120, cols: int = 160) -> np.ndarray:
    """Make a ball's colours, up to 60 levels to either side, in a fifth of the image's width."""
    x, y = positions(rows, cols)
    inside = (x - 0.2) ** 2 + (y + 0.1) ** 2 < 0.1
    return np.stack([300 * (x - 0.2) * inside, 300 * (y + 0.1) * inside, -10.0 * inside])


def drift(rows: int = 120, cols: int = 160) -> np.ndarray:
    x, y = positions(rows, cols)
    return np.stack([3 + 4 * x - 2 * y, 5 * x * y - 3, 2 - 6 * x**2 + y**2])


def test_smooth_drift_is_removed_and_the_contact_kept(rng: np.random.Generator) -> None:
    noise = rng.normal(0, 1, (2, *contact().shape))
    photographs = torch.tensor(np.stack([contact(), -0.7 * contact()]) + drift() + noise, dtype=torch.float32)
    left = without_drift(photographs).numpy() - noise - np.stack([contact(), -0.7 * contact()])
    assert np.abs(drift()).max() > 7
    assert np.abs(left).mean() < 0.2
    assert np.abs(left).max() < 1.0


def test_drift_equals_weighted_least_squares() -> None:
    change = contact(SIDE, SIDE) + drift(SIDE, SIDE)
    x, y = (axis.ravel() for axis in positions(SIDE, SIDE))
    terms = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
    levels, fitted = change.reshape(3, -1).T, np.zeros((SIDE**2, 3))
    for _ in range(ROUNDS):
        root = 1 / (1 + np.square(levels - fitted).sum(axis=1, keepdims=True) / SCALE**2)
        none = np.sqrt(HIDDEN * (1 - root**2))
        rows, values = np.concatenate([root * terms, none * terms]), np.concatenate([root * levels, 0 * levels])
        fitted = terms @ np.linalg.lstsq(rows, values, rcond=None)[0]
    corrected = without_drift(torch.tensor(change[None]))[0].numpy()
    np.testing.assert_allclose(corrected, change - fitted.T.reshape(change.shape), atol=0.05)


def test_a_wide_contact_is_not_taken_for_drift() -> None:
    x, y = positions(SIDE, SIDE)
    for width, most in ((1, 4), (0.4, 0.5)):  # levels of 40; little of the gel is at rest, and in the first all of that on one side
        gel = 40 * np.exp(-((x - 0.8) ** 2 + y**2) / width)
        change = np.stack([gel, -gel, 0.5 * gel])
        taken = np.abs(change - without_drift(torch.tensor(change[None]))[0].numpy())
        assert taken.max() < most


def test_drift_has_gradients_after_a_call_in_inference_mode() -> None:
    photographs = torch.tensor(contact(37, 53)[None], dtype=torch.float32)
    with torch.inference_mode():
        expected = without_drift(photographs.clone())
    change = photographs.clone().requires_grad_()
    left = without_drift(change)
    left.square().sum().backward()
    assert torch.equal(left, expected)
    assert change.grad is not None
    assert change.grad.isfinite().all()
