"""Cameras: pose, projection, resolution, looking at a target; and those of 3D-R2N2's renderings, by single points."""

import numpy as np
import pytest

from pipeline.kernels.vision.camera import (
    Viewpoint,
    camera_pose,
    look_at,
    placed_camera,
    project_points,
    projection_matrix,
    viewpoint_camera,
)
from pipeline.kernels.vision.scene import Camera
from tests.kernels.vision.shapes import CENTRE, SCENE

CAMERA = SCENE.camera


def test_axis_of_the_shipped_camera_passes_the_object_centre_at_6_mm() -> None:
    forward = -camera_pose(CAMERA)[:3, 2]
    assert forward == pytest.approx([-0.8525, -0.4028, -0.3333], abs=5e-5)
    to_centre = CENTRE - CAMERA.position
    passes_by = np.linalg.norm(np.cross(to_centre, forward))
    assert passes_by == pytest.approx(0.006, abs=0.0005)


def test_projection_is_that_of_a_pinhole() -> None:
    frame = camera_pose(CAMERA)
    inside = np.array([[0, 0, -1.0], [0.1, 0, -1.0], [0, 0.1, -2.0], [-0.2, -0.3, -1.5]])
    world = inside @ frame[:3, :3].T + frame[:3, 3]
    (fx, fy), (cx, cy) = CAMERA.focal, CAMERA.centre
    depth = -inside[:, 2]
    expected = np.column_stack([cx + fx * inside[:, 0] / depth, cy - fy * inside[:, 1] / depth])
    assert project_points(projection_matrix(CAMERA), world) == pytest.approx(expected, abs=1e-9)


def test_look_at_centres_the_target_without_roll() -> None:
    moved = look_at(CAMERA, (-0.3, -1.1, 0.2), (0.0, 0.1, 0.6))
    assert project_points(projection_matrix(moved), np.array([0.0, 0.1, 0.6])) == pytest.approx([128, 128], abs=1e-9)
    assert camera_pose(moved)[2, 0] == pytest.approx(0, abs=1e-15)
    assert camera_pose(moved)[2, 1] > 0


def test_points_just_in_front_of_the_camera_project() -> None:
    frame = camera_pose(CAMERA)
    for ahead, seen in ((1e-9, True), (-1e-9, False), (-1e3, False), (1e3, True)):
        assert np.isfinite(project_points(projection_matrix(CAMERA), frame[:3, 3] - ahead * frame[:3, 2])).all() == seen
    assert project_points(projection_matrix(CAMERA), np.zeros((0, 3))).shape == (0, 2)


def test_square_camera_of_a_scene_covers_the_shorter_side_of_its_first_camera() -> None:
    stated = Camera(name="wide", position=(1, 0, 0.5), rotation=(90, 0, 90), focal=(700, 700), centre=(320, 240), size=(640, 480))
    square = SCENE.model_copy(update={"cameras": (stated,)}).square_camera(96)
    assert square.shape == (96, 96)
    assert square.focal == pytest.approx((140, 140))
    assert (square.centre, square.position) == ((48, 48), stated.position)


@pytest.mark.parametrize(
    ("function", "named"),
    [
        (lambda: project_points(projection_matrix(CAMERA), np.array([0, 0, np.nan])), "drop"),
        (lambda: look_at(CAMERA, (0.0, np.inf, 0.0), (1.0, 0.0, 0.0)), "finite"),
        (lambda: look_at(CAMERA, (0.0, 0.0, 1.0), (0.0, 0.0, 0.6)), "sideways"),
        (lambda: CAMERA.with_resolution(0), "0 pixels"),
    ],
)
def test_invalid_points_directions_and_resolutions_are_rejected(function, named) -> None:
    with pytest.raises(ValueError, match=named):
        function()


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
