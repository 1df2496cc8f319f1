"""The local network: its reach, windows beside whole images, its loss."""

import pytest
import torch

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.local_network import GelState, LocalNetwork, LocalShape, local_loss, pixel_positions, surface_slopes

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


def test_depth_is_the_integral_of_slopes_and_contact_gives_them_no_gradient(network: LocalNetwork, change: torch.Tensor) -> None:
    shape = network(change, pixel_positions(24, 30), PITCH)
    assert shape.depth.shape == shape.contact.shape == (1, 24, 30)
    shape.contact.sum().backward()
    assert all(parameter.grad is None for parameter in network.colours.parameters())
    network.zero_grad(set_to_none=True)


def test_loss_is_minimal_at_the_truth_and_grows_with_each_error() -> None:
    depth = torch.zeros(1, 12, 12)
    depth[:, 4:8, 4:8] = 0.1
    truth = GelState(depth, depth > 0)
    right = LocalShape(surface_slopes(depth, PITCH), depth, torch.where(depth > 0, 20.0, -20.0))
    least = float(local_loss(right, truth, PITCH))
    assert least < 1e-6
    for wrong in (
        right._replace(slopes=right.slopes + 0.1),
        right._replace(depth=right.depth + 0.05),
        right._replace(contact=-right.contact),
    ):
        assert float(local_loss(wrong, truth, PITCH)) > least + 1e-3


def test_diverged_network_is_refused() -> None:
    nothing = torch.zeros(1, 8, 8)
    shape = LocalShape(torch.full((1, 2, 8, 8), torch.nan), nothing, nothing)
    with pytest.raises(InvalidInput, match="it has diverged"):
        local_loss(shape, GelState(nothing, nothing > 0), PITCH)
