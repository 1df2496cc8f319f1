"""Surfaces from slopes: with the rim pinned, and free where something presses on it."""

import numpy as np
import pytest
import torch

from pipeline.kernels.networks.slope_integration import PRESSED, free_pressed_rim, integrate_slopes
from tests.references.slow_slopes import integrate_slowly

PITCH = (0.12, 0.1)
ROWS, COLS = 60, 80


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


def read(slopes: np.ndarray, pitch: tuple[float, float] = PITCH) -> np.ndarray:
    given = torch.tensor(slopes)[None]
    return np.asarray(free_pressed_rim(integrate_slopes(given, pitch), given, pitch)[0])


def cap(x: float, y: float, radius: float = 3.0, deepest: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    """Make the depth (ROWS, COLS) and slopes of a ball's cap in a gel of 8 x 7.2 mm, its middle at x and y from the first corner, mm."""
    across, down = PITCH[1] * (np.arange(COLS) + 0.5) - x, PITCH[0] * (np.arange(ROWS)[:, None] + 0.5) - y
    height = np.sqrt(np.maximum(radius**2 - across**2 - down**2, (radius - deepest) ** 2))
    pressed = height > radius - deepest
    return height - (radius - deepest), np.stack([-across / height * pressed, -down / height * pressed])


@pytest.mark.parametrize("shape", [(1, 5), (7, 2), (12, 17)])
def test_surface_with_a_free_rim_equals_that_of_a_sparse_solver(shape: tuple[int, int]) -> None:
    slopes = np.random.default_rng(0).normal(0.0, 0.1, (2, *shape))
    expected = integrate_slowly(slopes, (0.3, 0.7), PRESSED)
    np.testing.assert_allclose(read(slopes, (0.3, 0.7)), expected, rtol=0, atol=1e-12)
    assert np.abs(expected - integrate_slowly(slopes, (0.3, 0.7))).max() > PRESSED


@pytest.mark.parametrize(("x", "y"), [(0.0, 3.6), (4.0, 7.2), (8.0, 0.0), (7.0, 6.5)])
def test_ball_cut_by_the_rim_is_read_at_its_depth(x: float, y: float) -> None:
    depth, slopes = cap(x, y)
    assert np.abs(read(slopes) - depth).max() < 0.03
    assert np.abs(integrate_slowly(slopes, PITCH) - depth).max() > 0.5


def test_ball_off_the_rim_is_read_to_the_bit_as_with_a_pinned_rim() -> None:
    inside, cut = (torch.tensor(cap(x, 3.6)[1]) for x in (4.0, 0.0))
    slopes = torch.stack([inside, cut, inside])
    pinned = integrate_slopes(slopes, PITCH)
    surfaces = free_pressed_rim(pinned, slopes, PITCH)
    assert torch.equal(surfaces[::2], pinned[::2])
    np.testing.assert_allclose(surfaces[1], read(slopes[1].numpy()), rtol=0, atol=1e-12)
    assert torch.equal(free_pressed_rim(pinned[:1], slopes[:1], PITCH), pinned[:1])


def test_ramp_down_to_one_side_is_read_at_its_depth() -> None:
    slopes = np.zeros((2, ROWS, COLS))
    slopes[0, :, COLS // 2 :] = 0.2
    depth = 0.2 * PITCH[1] * np.maximum(np.arange(COLS) + 0.5 - COLS // 2, 0)
    assert np.abs(read(slopes) - depth).max() < 0.03


def test_flat_face_over_a_corner_is_read_at_its_depth() -> None:
    """Show no slopes at the rim but at the face's walls."""
    depth = np.zeros((ROWS, COLS))
    depth[:20, 50:] = 0.5
    depth[20:25, 50:] = 0.5 * (1 - (np.arange(5) + 0.5) / 5)[:, None]
    slopes = np.stack([np.gradient(depth, PITCH[1], axis=1), np.gradient(depth, PITCH[0], axis=0)])
    assert np.abs(read(slopes) - depth)[:18, 52:].max() < 0.01
    assert np.abs(integrate_slowly(slopes, PITCH) - depth)[:18, 52:].max() > 0.4


def test_gel_that_is_pressed_evenly_all_over_shows_nothing() -> None:
    assert not read(np.zeros((2, ROWS, COLS))).any()
