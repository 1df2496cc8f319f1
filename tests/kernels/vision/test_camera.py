"""Cameras: pose, projection, resolution, and looking at a target."""

import numpy as np
import pytest

from pipeline.kernels.geometry.transforms import rotation_from_euler
from pipeline.kernels.vision.camera import camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import NamedCamera
from tests.kernels.vision.shapes import CENTRE, SCENE

CAMERA = SCENE.camera


def test_axis_of_the_shipped_camera_passes_the_object_centre_at_6_mm() -> None:
    forward = -camera_pose(CAMERA)[:3, 2]
    assert forward == pytest.approx([-0.8525, -0.4028, -0.3333], abs=5e-5)
    to_centre = CENTRE - CAMERA.position
    passes_by = np.linalg.norm(np.cross(to_centre, forward))
    assert passes_by == pytest.approx(0.006, abs=0.0005)


def test_camera_pose_applies_extrinsic_euler_angles() -> None:
    rotation = camera_pose(CAMERA)[:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1)
    # Quarter turns about x, then z: y goes to z and stays there; z goes to -y, and then to x.
    quarter = rotation_from_euler((np.pi / 2, 0.0, np.pi / 2))
    assert quarter @ [0, 1, 0] == pytest.approx([0, 0, 1], abs=1e-15)
    assert quarter @ [0, 0, 1] == pytest.approx([1, 0, 0], abs=1e-15)


def test_projection_is_that_of_a_pinhole() -> None:
    frame = camera_pose(CAMERA)
    inside = np.array([[0, 0, -1.0], [0.1, 0, -1.0], [0, 0.1, -2.0], [-0.2, -0.3, -1.5]])
    world = inside @ frame[:3, :3].T + frame[:3, 3]
    (fx, fy), (cx, cy) = CAMERA.focal, CAMERA.centre
    depth = -inside[:, 2]
    expected = np.column_stack([cx + fx * inside[:, 0] / depth, cy - fy * inside[:, 1] / depth])
    assert project_points(projection_matrix(CAMERA), world) == pytest.approx(expected, abs=1e-9)


def test_points_behind_the_camera_project_to_nan() -> None:
    behind = np.array(CAMERA.position) + camera_pose(CAMERA)[:3, 2]
    assert np.isnan(project_points(projection_matrix(CAMERA), behind)).all()


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
    stated = NamedCamera(name="wide", position=(1, 0, 0.5), rotation=(90, 0, 90), focal=(700, 700), centre=(320, 240), size=(640, 480))
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
