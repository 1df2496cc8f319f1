import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.kernels.geometry.transforms import rotation_from_euler
from pipeline.kernels.vision.camera import camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import Scene
from tests.vision.shapes import CENTRE, SCENE, ball

CAMERA = SCENE.camera


def test_the_supplements_camera_looks_where_the_readings_say() -> None:
    forward = -camera_pose(CAMERA)[:3, 2]
    assert forward == pytest.approx([-0.8525, -0.4028, -0.3333], abs=5e-5)
    to_centre = CENTRE - CAMERA.position
    passes_by = np.linalg.norm(np.cross(to_centre, forward))
    assert passes_by == pytest.approx(0.006, abs=0.0005)


def test_field_of_view() -> None:
    assert 2 * np.degrees(np.arctan(128 / CAMERA.focal[0])) == pytest.approx(34.95, abs=0.005)


def test_pose_is_a_rotation_and_turns_about_the_worlds_axes_in_turn() -> None:
    rotation = camera_pose(CAMERA)[:3, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1)
    # Quarter turns about x, then z: y goes to z and stays there; z goes to -y, and then to x.
    quarter = rotation_from_euler((np.pi / 2, 0.0, np.pi / 2))
    assert quarter @ [0, 1, 0] == pytest.approx([0, 0, 1], abs=1e-15)
    assert quarter @ [0, 0, 1] == pytest.approx([1, 0, 0], abs=1e-15)


def test_points_given_in_the_cameras_frame_fall_where_a_pinhole_puts_them() -> None:
    frame = camera_pose(CAMERA)
    inside = np.array([[0, 0, -1.0], [0.1, 0, -1.0], [0, 0.1, -2.0], [-0.2, -0.3, -1.5]])
    world = inside @ frame[:3, :3].T + frame[:3, 3]
    (fx, fy), (cx, cy) = CAMERA.focal, CAMERA.centre
    depth = -inside[:, 2]
    expected = np.column_stack([cx + fx * inside[:, 0] / depth, cy - fy * inside[:, 1] / depth])
    assert project_points(projection_matrix(CAMERA), world) == pytest.approx(expected, abs=1e-9)


def test_points_behind_the_camera_have_no_image() -> None:
    behind = np.array(CAMERA.position) + camera_pose(CAMERA)[:3, 2]
    assert np.isnan(project_points(projection_matrix(CAMERA), behind)).all()


def test_half_the_resolution_halves_the_image_coordinates() -> None:
    points = ball().vertices
    full, half = (project_points(projection_matrix(CAMERA.with_resolution(size)), points) for size in (256, 128))
    assert half == pytest.approx(full / 2, abs=1e-9)


def test_look_at_puts_the_target_in_the_middle_and_keeps_the_horizon() -> None:
    moved = look_at(CAMERA, (-0.3, -1.1, 0.2), (0.0, 0.1, 0.6))
    assert project_points(projection_matrix(moved), np.array([0.0, 0.1, 0.6])) == pytest.approx([128, 128], abs=1e-9)
    assert camera_pose(moved)[2, 0] == pytest.approx(0, abs=1e-15)
    assert camera_pose(moved)[2, 1] > 0
    with pytest.raises(ValueError, match="sideways"):
        look_at(CAMERA, (0.0, 0.0, 1.0), (0.0, 0.0, 0.6))


def test_scene_is_frozen_and_survives_a_round_trip() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        SCENE.name = "other"
    assert Scene.model_validate(SCENE.model_dump()) == SCENE
