"""The second view of a grasp: patches, gel squares, and the camera that shows both."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given

from pipeline.dataset.mesh_rows import mesh_row
from pipeline.drawing.colors import COLORS
from pipeline.drawing.grasp_pictures import LIFT, STRIDE, GraspPictures, gel_squares, touch_patch
from pipeline.drawing.views import fitted_camera
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.vision.camera import Camera, camera_pose, project_points, projection_matrix
from stages.render_vision.renderer import Renderer
from tests.kernels.vision.shapes import SCENE, ball
from tests.strategies import EPS, offsets, random_rotation, seeds

SENSOR = load_sensor("gel_16mm")
SMALL = SENSOR.model_copy(update={"width": 0.01, "w": 0.005, "rows": 10, "cols": 10})


@pytest.mark.parametrize("position", [(0, 0, 1.6), (0.5, -0.8, 1.0), (0.0, 0.0, -0.4)])
@pytest.mark.parametrize("size", [0.02, 0.5, 8.0])
def test_fitted_camera_shows_all_points_whole_from_its_side(position, size) -> None:
    """From straight above or below too, and of objects that its position is inside of."""
    camera = Camera(name="camera", position=position, rotation=(0, 0, 30), focal=(200, 200), centre=(64, 64), resolution=128)
    corners = size * (np.array(list(product((-0.5, 0.5), repeat=3)))) + (0, 0, 0.6)
    fitted = fitted_camera(camera, corners, fill=0.9)
    pixels = project_points(projection_matrix(fitted), corners) - 64
    assert np.abs(pixels).max() == pytest.approx(0.9 * 64)
    np.testing.assert_allclose(project_points(projection_matrix(fitted), np.array([0, 0, 0.6])), [64, 64], atol=1e-6)
    towards = np.array(fitted.position) - (0, 0, 0.6)
    np.testing.assert_allclose(np.cross(towards, np.array(position) - (0, 0, 0.6)), 0, atol=1e-9)


def test_touch_patch_lies_in_front_of_the_surface() -> None:
    depth = np.full((100, 100), 0.02, np.float32)
    depth[:50] = 0.004
    frame = np.eye(4)
    frame[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    frame[:3, 3] = [1, 2, 3]
    mesh = touch_patch(depth, frame, SENSOR, COLORS[0])
    assert mesh is not None
    used = mesh.vertices[np.unique(mesh.faces)]
    assert used[:, 0] == pytest.approx(np.full(len(used), 1 + 0.004 - LIFT))  # the sensor's z is the world's x
    assert used[:, 2].max() < 3  # its rows run along the world's z, and the upper half felt nothing
    assert np.abs(used[:, 1] - 2).max() < SENSOR.width / 2


@given(seed=seeds, offset=offsets)
def test_touch_patch_and_gel_square_follow_the_sensor_pose(seed, offset) -> None:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = random_rotation(np.random.default_rng(seed)), offset
    full = np.full((10, 10), 0.003, np.float32)
    mesh = touch_patch(full, frame, SMALL, (1, 2, 3))
    assert mesh is not None
    local = (mesh.vertices - offset) @ frame[:3, :3]
    assert np.abs(local[:, 2] - (float(full[0, 0]) - LIFT)).max() <= 16 * EPS * (np.abs(offset).max() + 1)
    corners = (gel_squares(frame[None], [SMALL])[0] - offset) @ frame[:3, :3]
    assert np.abs(np.abs(corners) - [0.005, 0.005, 0.005]).max() <= 16 * EPS * (np.abs(offset).max() + 1)


def test_empty_gel_has_no_patch() -> None:
    nothing = np.full((10, 10), np.inf, np.float32)
    needle = nothing.copy()
    needle[STRIDE, STRIDE] = 0.001
    for depth in (nothing, needle):
        assert touch_patch(depth, np.eye(4), SMALL, (1, 2, 3)) is None


def test_second_view_of_an_object_around_the_first_camera() -> None:
    """The first camera is inside the object, the second one outside."""
    hand = load_hand("two_finger_gripper")
    pose, angles = np.eye(4), (hand.lower + hand.upper) / 2
    pose[:3, 3] = [3.0, 0, 0.6]
    grasp = {"hand_pose": pose, "joint_angles": angles, "sensor_pose": sensor_poses(hand, pose, angles), "touch_success": np.zeros(2, bool)}
    rows = {
        "surfaces": mesh_row(ball(3.0, subdivisions=2)),
        "grasps": {name: value[None] for name, value in grasp.items()},
        "touch": {"depth": np.full((1, 2, 10, 10), np.inf, np.float32)},
    }
    with Renderer(SCENE, 48) as renderer, GraspPictures(renderer, SCENE, hand, [SMALL] * 2).second_side(rows, 0, 48) as side:
        image = side.touched()
    background = np.rint(np.array(SCENE.background) * 255)
    shown = np.abs(image.astype(int) - background).max(axis=2) > 2
    assert 0.3 < shown.mean() < 0.9  # all of the ball, from outside: a disc
    assert not shown[0].any()
    assert np.linalg.norm(camera_pose(SCENE.camera)[:3, 3] - [0, 0, 0.6]) < 3.0
