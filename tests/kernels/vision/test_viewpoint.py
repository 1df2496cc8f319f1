"""The cameras of 3D-R2N2's renderings, against what its convention says of single points."""

import numpy as np
import pytest

from pipeline.kernels.vision.camera import Viewpoint, placed_camera, project_points, viewpoint_camera


def viewpoint(azimuth: float, elevation: float, distance: float = 1.0) -> Viewpoint:
    return Viewpoint(azimuth, elevation, 0.0, distance)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "position"),
    [(0, 0, [1.75, 0, 0]), (90, 0, [0, 0, 1.75]), (180, 0, [-1.75, 0, 0]), (0, 30, [1.75 * np.cos(np.pi / 6), 0.875, 0])],
)
def test_camera_centre_follows_the_metadata(azimuth, elevation, position):
    camera = viewpoint_camera(viewpoint(azimuth, elevation), 137)
    centre = -np.linalg.solve(camera[:, :3], camera[:, 3])
    np.testing.assert_allclose(centre, position, atol=1e-12)
    assert project_points(camera, np.zeros(3)) == pytest.approx([68.5, 68.5])
    assert camera[2, 3] == pytest.approx(1.75)  # the depth of the origin


def test_axes_of_the_image_for_a_35_mm_lens_on_a_32_mm_sensor():
    """From +x, +y is up and +z to the left; 0.175 at a distance of 1.75 is a tenth of the focal length, 35/32 of the image's width."""
    camera, tenth = viewpoint_camera(viewpoint(0, 0), 320), 0.1 * 350
    assert project_points(camera, np.array([0, 0.175, 0])) == pytest.approx([160, 160 - tenth])
    assert project_points(camera, np.array([0, 0, 0.175])) == pytest.approx([160 - tenth, 160])
    nearer = viewpoint_camera(viewpoint(0, 0, distance=0.5), 320)
    assert project_points(nearer, np.array([0, 0.175, 0])) == pytest.approx([160, 160 - 2 * tenth])


def test_placed_camera_projects_the_world_as_the_camera_projects_the_file():
    turned = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = 0.37 * turned, [0.1, -0.2, 0.6]
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 3))
    camera = viewpoint_camera(viewpoint(123, 27, 0.8), 137)
    world = points @ placement[:3, :3].T + placement[:3, 3]
    placed = placed_camera(camera, placement)
    np.testing.assert_allclose(project_points(placed, world), project_points(camera, points), atol=1e-9)
    assert np.linalg.norm(placed[2, :3]) == pytest.approx(1)  # depth in metres
