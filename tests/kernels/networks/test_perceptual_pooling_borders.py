"""Vertices behind the camera, on its plane, on the image's border and 10 m away."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from pipeline.kernels.networks.image_encoder import NEAREST_DEPTH, MapGrid, pool_features, project_to_pixels
from tests.kernels.networks.test_perceptual_pooling import SCENE, scene_camera, slow_pool
from tests.strategies import seeds

EYE = np.array(SCENE.position)
SIZE, FOCAL = SCENE.resolution, SCENE.focal[0]
GRID, MAP = MapGrid(5.5, 2), 124
"""Of the 12-layer encoder's first tap, or nearly."""
DEPTHS = st.sampled_from(
    [-1e3, -1.0, -NEAREST_DEPTH, -1e-9, 0.0, 1e-9, NEAREST_DEPTH / 2, NEAREST_DEPTH, 2 * NEAREST_DEPTH, 1.3, 1e3]
) | st.floats(-1e3, 1e3)
SIDEWAYS = st.sampled_from([-10.0, -1.0, 0.0, 1e-9, 0.3, 10.0]) | st.floats(-10, 10)


def placed(depth: float, right: float, down: float) -> np.ndarray:
    """Compute a world point (m) from its coordinates in the camera's frame."""
    axes = scene_camera().numpy()[:, :3].copy()
    axes[:2] = (axes[:2] - SIZE / 2 * axes[2]) / FOCAL  # right and down, from the projection's rows
    return EYE + np.array([right, down, depth]) @ axes


def seen(camera: Tensor, point: np.ndarray, dtype: torch.dtype = torch.float64) -> Tensor:
    """(2,) column and row."""
    return project_to_pixels(camera.to(dtype), torch.from_numpy(point).to(dtype)[None, None])[0, 0]


@given(depth=DEPTHS, right=SIDEWAYS, down=SIDEWAYS)
def test_projected_points_stay_on_their_side_of_the_image(depth: float, right: float, down: float) -> None:
    """As a point at least `NEAREST_DEPTH` in front of the camera at the same place beside the viewing direction."""
    column, row = seen(scene_camera(), placed(depth, right, down)).tolist()
    forward = max(depth, NEAREST_DEPTH)
    expected = [SIZE / 2 + FOCAL * sideways / forward for sideways in (right, down)]
    np.testing.assert_allclose([column, row], expected, rtol=1e-9, atol=1e-6 if forward > NEAREST_DEPTH else 1e-4)


@given(depth=DEPTHS, right=SIDEWAYS, down=SIDEWAYS, offset=st.sampled_from([0.0, 0.6, 10.0]))
def test_float32_projection_has_the_documented_error(depth: float, right: float, down: float, offset: float) -> None:
    """Also with camera and object 10 m from the origin."""
    camera, point = scene_camera().float().double(), torch.from_numpy(placed(depth, right, down) + offset).float().double()
    camera[:, 3] -= camera[:, :3] @ torch.full((3,), offset, dtype=torch.float64)
    camera = camera.float().double()
    exact, found = seen(camera, point.numpy()), seen(camera, point.numpy(), torch.float32).double()
    summed = camera.abs()[:, :3] @ point.abs() + camera.abs()[:, 3]  # Σ |camera| |point|, of columns, rows and depth
    far = max(float(camera[2, :3] @ point + camera[2, 3]), NEAREST_DEPTH)
    bound = 1e-6 * (summed[:2] + (exact.abs() + SIZE) * summed[2]) / far + 1e-6 * exact.abs()
    assert bool(((found - exact).abs() <= bound).all())


def test_pixels_in_the_scene_are_accurate_to_a_thousandth() -> None:
    points = torch.from_numpy(np.random.default_rng(0).uniform(-0.25, 0.25, (1, 500, 3)) + [0, 0, 0.6])
    error = project_to_pixels(scene_camera().float(), points.float()).double() - project_to_pixels(scene_camera(), points.float().double())
    assert float(error.abs().max()) <= 1e-3


BORDER = st.sampled_from([GRID.start, GRID.start + GRID.jump * (MAP - 1), 0.0, 0.5, SIZE - 0.5, float(SIZE), -1e9, 1e9, 1e30])
PLACES = st.tuples(BORDER | st.floats(-300, 600), BORDER | st.floats(-300, 600), st.sampled_from([-1, 0, 1]))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@given(place=PLACES, seed=seeds)
def test_pooling_at_and_beyond_the_border_equals_plain_arithmetic(dtype: torch.dtype, place: tuple[float, float, int], seed: int) -> None:
    """Places are taken as floats of the type, and the ones next to them."""
    column, row = (np.nextafter(np.float32(value), np.float32(place[2] * np.inf)) if place[2] else np.float32(value) for value in place[:2])
    features = torch.from_numpy(np.random.default_rng(seed).uniform(-1, 1, (1, 2, MAP, MAP)).astype(np.float32)).to(dtype)
    pixels = torch.tensor([[[column, row]]], dtype=dtype, requires_grad=True)
    pooled = pool_features([features], [GRID], pixels)
    expected = slow_pool(features[0].double().numpy(), GRID, float(column), float(row))
    np.testing.assert_allclose(pooled[0, 0].detach().double().numpy(), expected, atol=1e-4 if dtype == torch.float32 else 1e-12)
    (gradient,) = torch.autograd.grad(pooled.sum(), pixels)
    assert bool(torch.isfinite(gradient).all())


@given(depth=DEPTHS, right=SIDEWAYS, down=SIDEWAYS)
def test_gradients_are_finite_in_float32_too(depth: float, right: float, down: float) -> None:
    point = torch.from_numpy(placed(depth, right, down)).float()[None, None].requires_grad_()
    features = torch.rand(1, 2, 9, 9, generator=torch.Generator().manual_seed(0))
    pooled = pool_features([features], [MapGrid(63.5, 8)], project_to_pixels(scene_camera().float(), point))
    (gradient,) = torch.autograd.grad(pooled.sum(), point)
    assert bool(torch.isfinite(pooled).all())
    assert bool(torch.isfinite(gradient).all())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_projection_rejects_points_and_cameras_that_are_not_finite(value: float) -> None:
    points, camera = torch.zeros(1, 2, 3).double(), scene_camera()
    with pytest.raises(ValueError, match=r"NaN or infinity in points.*diverged"):
        project_to_pixels(camera, points + value)
    with pytest.raises(ValueError, match="NaN or infinity in camera"):
        project_to_pixels(camera * value, points)


def test_projection_rejects_mismatched_types() -> None:
    with pytest.raises(ValueError, match=r"points of type torch\.bfloat16"):
        project_to_pixels(scene_camera().bfloat16(), torch.zeros(1, 2, 3, dtype=torch.bfloat16))
    with pytest.raises(ValueError, match=r"camera is torch\.float64, points are torch\.float32"):
        project_to_pixels(scene_camera(), torch.zeros(1, 2, 3))
