"""Perceptual pooling on ramps and against plain arithmetic."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from pipeline.kernels.networks.image_encoder import NEAREST_DEPTH, MapGrid, pool_features, project_to_pixels
from pipeline.kernels.vision.camera import Camera, project_points, projection_matrix

SCENE = Camera(
    name="camera",
    position=(0.972, 0.461, 0.974),
    rotation=(70.458, 4.94, 113.54),
    focal=(406.595, 406.595),
    centre=(128, 128),
    resolution=256,
)


def scene_camera() -> Tensor:
    return torch.from_numpy(projection_matrix(SCENE))


def slow_pool(features: np.ndarray, grid: MapGrid, column: float, row: float) -> np.ndarray:
    """(C,) one feature of a map (C, H, W), in plain arithmetic."""
    _, rows, columns = features.shape
    x = min(max((column - grid.start) / grid.jump, 0), columns - 1)
    y = min(max((row - grid.start) / grid.jump, 0), rows - 1)
    left, top = min(int(x), columns - 2), min(int(y), rows - 2)
    a, b = x - left, y - top
    upper = (1 - a) * features[:, top, left] + a * features[:, top, left + 1]
    lower = (1 - a) * features[:, top + 1, left] + a * features[:, top + 1, left + 1]
    return np.asarray((1 - b) * upper + b * lower)


def test_pooling_equals_plain_arithmetic() -> None:
    rng = np.random.default_rng(0)
    grids = [MapGrid(5.5, 2), MapGrid(7.5, 4)]
    maps = [rng.normal(size=(2, 3, 9, 12)), rng.normal(size=(2, 5, 4, 3))]
    pixels = rng.uniform(-10, 40, size=(2, 60, 2))
    pooled = pool_features([torch.from_numpy(features) for features in maps], grids, torch.from_numpy(pixels))
    expected = [
        [
            np.concatenate([slow_pool(features[item], grid, *place) for features, grid in zip(maps, grids, strict=True)])
            for place in pixels[item]
        ]
        for item in range(2)
    ]
    np.testing.assert_allclose(pooled.numpy(), np.array(expected), atol=1e-12)


def test_pooling_of_a_map_with_one_element() -> None:
    features = torch.tensor([[[[3.0]], [[-1.0]]]])
    pooled = pool_features([features], [MapGrid(103.5, 16)], torch.tensor([[[0.0, 0.0], [103.5, 103.5], [500.0, 7.0]]]))
    torch.testing.assert_close(pooled, torch.tensor([3.0, -1.0]).expand(1, 3, 2))


def test_projected_pixels_equal_those_of_the_camera_model() -> None:
    points = np.random.default_rng(1).uniform(-0.4, 0.4, size=(2, 40, 3)) + [0, 0, 0.6]
    pixels = project_to_pixels(scene_camera(), torch.from_numpy(points))
    np.testing.assert_allclose(pixels.numpy(), project_points(scene_camera().numpy(), points), atol=1e-9)
    each = project_to_pixels(scene_camera().expand(2, 3, 4), torch.from_numpy(points))
    torch.testing.assert_close(each, pixels)


def test_points_behind_the_camera_project_outside_the_image_on_their_side() -> None:
    camera = scene_camera()
    forward = camera[2, :3]
    right = torch.linalg.cross(forward, torch.tensor([0.0, 0, 1]).double())
    eye = torch.tensor(SCENE.position, dtype=torch.float64)
    for sign in (-1, 1):
        for depth in (-2.0, -1e-3, 0.0, NEAREST_DEPTH / 2):
            column = project_to_pixels(camera, (eye + depth * forward + 0.3 * sign * right)[None, None])[0, 0, 0]
            assert torch.isfinite(column)
            assert column > 256 if sign > 0 else column < 0
    torch.testing.assert_close(project_to_pixels(camera, (eye - 3 * forward)[None, None])[0, 0], torch.tensor([128.0, 128.0]).double())


def test_gradients_behind_and_at_the_camera_are_finite() -> None:
    camera = scene_camera()
    eye = torch.tensor(SCENE.position, dtype=torch.float64)
    points = torch.stack([eye, eye - camera[2, :3], eye + 1e-9, eye + torch.tensor([0.0, 0, 5]), eye * 1e6])[None].requires_grad_()
    features = torch.rand(1, 4, 17, 17, dtype=torch.float64)
    pooled = pool_features([features], [MapGrid(63.5, 8)], project_to_pixels(camera, points))
    (gradient,) = torch.autograd.grad(pooled.sum(), points)
    assert torch.isfinite(pooled).all()
    assert torch.isfinite(gradient).all()


def test_gradcheck_of_maps_and_points() -> None:
    generator = torch.Generator().manual_seed(5)
    features = torch.randn(2, 3, 51, 51, dtype=torch.float64, generator=generator, requires_grad=True)
    points = torch.rand(2, 6, 3, dtype=torch.float64, generator=generator) * 0.4 - 0.2 + torch.tensor([0, 0, 0.6])
    assert torch.autograd.gradcheck(
        lambda maps, places: pool_features([maps], [MapGrid(27.5, 4)], project_to_pixels(scene_camera(), places)),
        (features, points.requires_grad_()),
        fast_mode=True,
    )


EYE = torch.eye(3, 4)


@pytest.mark.parametrize(
    ("camera", "points", "named"),
    [
        (EYE, torch.full((1, 2, 3), math.nan), "points"),
        (EYE * math.inf, torch.zeros(1, 2, 3), "camera"),
    ],
)
def test_projection_rejects_invalid_cameras_and_points(camera: Tensor, points: Tensor, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        project_to_pixels(camera, points)
