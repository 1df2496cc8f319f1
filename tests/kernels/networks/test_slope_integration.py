"""Integration of slopes: against a sparse solver, against surfaces, and its derivatives."""

import numpy as np
import pytest
import torch

from pipeline.kernels.networks.local_network import integrate_slopes
from tests.references.slow_slopes import integrate_slowly


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (7, 2), (12, 17)])
def test_surface_equals_that_of_a_sparse_solver(shape: tuple[int, int]) -> None:
    slopes = np.random.default_rng(0).normal(size=(2, *shape))
    surface = integrate_slopes(torch.tensor(slopes)[None], (0.3, 0.7))[0].numpy()
    np.testing.assert_allclose(surface, integrate_slowly(slopes, (0.3, 0.7)), rtol=0, atol=1e-12)


def test_gradient_equals_finite_differences() -> None:
    slopes = torch.randn(1, 2, 4, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    assert torch.autograd.gradcheck(lambda given: integrate_slopes(given, (0.2, 0.3)), (slopes,))


def test_gradients_flow_after_a_call_in_inference_mode() -> None:
    with torch.inference_mode():
        integrate_slopes(torch.zeros(1, 2, 13, 14), (0.2, 0.3))
    slopes = torch.zeros(1, 2, 13, 14, requires_grad=True)
    integrate_slopes(slopes, (0.2, 0.3)).sum().backward()
    assert slopes.grad is not None


def test_slopes_of_wrong_shape_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"shape \(2, 4, 5\)"):
        integrate_slopes(torch.zeros(2, 4, 5), (1.0, 1.0))
