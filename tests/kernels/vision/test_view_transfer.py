"""Images moved to other cameras of the same place, and their background."""

import numpy as np
import pytest

from pipeline.kernels.vision.camera import Camera, look_at, project_points, projection_matrix
from pipeline.kernels.vision.view_transfer import (
    camera_direction,
    carried_camera,
    foreground,
    optical_centre,
    split_projection,
    transfer_view,
)
from tests.strategies import random_rotation

TARGET = np.array([0.0, 0.0, 0.6])
TRAINING = projection_matrix(
    Camera(
        name="camera", position=(0.972, 0.461, 0.974), rotation=(70.458, 4.94, 113.54), focal=(406, 410), centre=(128, 131), resolution=256
    )
)


def seen_from(rng: np.random.Generator, azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """Make a camera in a direction of the target, aimed roughly at it and rolled."""
    place = TARGET + distance * np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    plain = Camera(name="camera", position=(0, 0, 0), rotation=(0, 0, 0), focal=(600, 610), centre=(320, 240), resolution=640)
    aimed = projection_matrix(look_at(plain, tuple(place), tuple(TARGET + rng.uniform(-0.05, 0.05, 3))))
    intrinsic, rotation = split_projection(aimed)
    angle = rng.uniform(-np.pi, np.pi)
    roll = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turned = intrinsic @ roll @ rotation
    return np.column_stack([turned, -turned @ place])


def test_projection_matrix_is_split_into_its_factors(rng: np.random.Generator) -> None:
    for _ in range(20):
        intrinsic = np.array([[rng.uniform(100, 900), 0, rng.uniform(0, 500)], [0, rng.uniform(100, 900), rng.uniform(0, 500)], [0, 0, 1]])
        rotation, centre = random_rotation(rng), rng.uniform(-2, 2, 3)
        matrix = intrinsic @ np.column_stack([rotation, -rotation @ centre])
        split = split_projection(matrix)
        np.testing.assert_allclose(split[0], intrinsic, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(split[1], rotation, atol=1e-12)
        np.testing.assert_allclose(optical_centre(matrix), centre, atol=1e-9)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "distance"), [(0.4, 0.3, 1.0), (-2.0, 1.2, 0.4), (3.0, -0.2, 2.5), (1.0, np.pi / 2 - 1e-3, 0.7)]
)
def test_carried_camera_shows_the_target_as_in_training(
    rng: np.random.Generator, azimuth: float, elevation: float, distance: float
) -> None:
    real = seen_from(rng, azimuth, elevation, distance)
    carried = carried_camera(TRAINING, real, TARGET)
    np.testing.assert_allclose(optical_centre(carried), optical_centre(real), atol=1e-9)
    np.testing.assert_allclose(project_points(carried, TARGET), project_points(TRAINING, TARGET), atol=1e-8)
    direction = camera_direction(real, TARGET)
    assert direction.distance == pytest.approx(distance)
    assert direction.elevation == pytest.approx(elevation)
    # a millimetre across the view has as many pixels, and the vertical plane through both leans alike
    steps = []
    for matrix, seen in ((carried, direction), (TRAINING, camera_direction(TRAINING, TARGET))):
        across = np.array([-np.sin(seen.azimuth), np.cos(seen.azimuth), 0]) * 1e-3
        steps.append(project_points(matrix, TARGET + across) - project_points(matrix, TARGET - across))
    np.testing.assert_allclose(*steps, rtol=1e-4, atol=1e-5)


def test_transferred_image_shows_points_where_the_other_camera_sees_them(rng: np.random.Generator) -> None:
    """Blobs drawn where a real camera sees points are, after the transfer, where the other camera sees them."""
    real = seen_from(rng, 1.0, 0.5, 1.2)
    other = carried_camera(TRAINING, real, TARGET)
    points = TARGET + rng.uniform(-0.1, 0.1, (6, 3))
    col, row = np.meshgrid(np.arange(640) + 0.5, np.arange(640) + 0.5)
    for point in points:
        at = project_points(real, point)
        blob = 255 * np.exp(-((col - at[0]) ** 2 + (row - at[1]) ** 2) / 2 / 5**2)
        image = np.repeat(np.rint(blob)[..., None], 3, axis=2).astype(np.uint8)
        moved, shown = transfer_view(image, real, other, (256, 256), (0, 0, 0))
        weight = moved[..., 0].astype(float)
        rows, cols = np.indices(weight.shape) + 0.5
        mean = np.array([(weight * cols).sum(), (weight * rows).sum()]) / weight.sum()
        np.testing.assert_allclose(mean, project_points(other, point), atol=0.1)
        assert 0 < shown <= 1


def test_image_of_the_same_camera_is_kept_and_missing_pixels_are_filled(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (256, 256, 3), dtype=np.uint8)
    same, shown = transfer_view(image, TRAINING, TRAINING, (256, 256), (9, 8, 7))
    assert same is image
    assert shown == 1
    shift = np.array([[1, 0, 100.0], [0, 1, 0], [0, 0, 1]])
    moved, shown = transfer_view(image, TRAINING, shift @ TRAINING, (256, 256), (9, 8, 7))
    assert (moved[:, :99] == (9, 8, 7)).all()
    np.testing.assert_allclose(moved[:, 101:].astype(int), image[:, 1:156], atol=1)
    assert shown == pytest.approx(156 / 256, abs=0.01)


def test_the_foreground_differs_from_most_of_the_border():
    image = np.full((20, 30, 3), 230, np.uint8)
    image[5:20, 10:14] = (228, 120, 230)  # reaches the border
    image[0, 0] += 4
    mask = foreground(image)
    assert mask.sum() == 15 * 4
    assert mask[5:, 10:14].all()
