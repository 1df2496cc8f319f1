"""Random paths, and sensors that follow them over shapes and patches."""

import numpy as np
import pytest

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.transforms import invert_pose
from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.press_shapes import PressRanges, draw_patch, draw_shape
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.slide_paths import CLEARANCE, PathRanges, draw_path, follow_path
from tests.kernels.touch.shapes import ball

SENSOR = load_sensor("gelsight", shape=(48, 64))
RANGES = PathRanges(depth=(3e-4, 9e-4), press_speed=(0.003, 0.006), slide_speed=(0.001, 0.003), twist_speed=(0.2, 0.6))
STEPS, RATE, EVERY = 32, 16.0, range(8)


def path(seed: int):
    return draw_path(STEPS, RATE, RANGES, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", EVERY)
def test_path_presses_slides_twists_and_lifts_within_its_ranges(seed):
    drawn = path(seed)
    moved = np.linalg.norm(drawn.motion[:, :3, 3], axis=1)
    turned = np.arctan2(drawn.motion[:, 1, 0], drawn.motion[:, 0, 0])
    assert drawn.time == pytest.approx(np.arange(STEPS) / RATE)
    assert drawn.depth[[0, -1]] == pytest.approx(-CLEARANCE)
    held = drawn.depth == drawn.depth.max()
    assert RANGES.depth[0] <= drawn.depth.max() <= RANGES.depth[1]
    assert held.sum() >= STEPS / 2
    slides, twists = np.diff(moved) > 1e-12, np.abs(np.diff(turned)) > 1e-12
    assert slides.any()
    assert twists.any()
    assert (slides & twists).sum() <= 1  # one step may do both
    assert not moved[: np.argmax(held)].any()  # not before it is pressed
    speeds = np.diff(moved) * RATE
    assert RANGES.slide_speed[0] <= speeds.max() <= RANGES.slide_speed[1] + 1e-9
    assert RANGES.twist_speed[0] <= np.abs(np.diff(turned)).max() * RATE <= RANGES.twist_speed[1] + 1e-9


def deepest(depths: list[np.ndarray]) -> np.ndarray:
    return np.array([(SENSOR.w - depth).max() for depth in depths])


def test_sensor_keeps_to_the_depths_of_the_path():
    rng, drawn = np.random.default_rng(3), path(3)
    relief = draw_shape(SENSOR, rng, PressRanges(depth=(5e-4, 5e-4)), drawn.motion, shapes=("bumps",))
    depths, poses = follow_path(relief, drawn, SENSOR)
    assert deepest(depths) == pytest.approx(drawn.depth, abs=1e-12)
    assert not any(impression(depths[k], SENSOR).any() for k in (0, -1))
    assert np.stack(poses)[:, :2] == pytest.approx(drawn.motion[:, :2])


def test_shape_moves_against_the_sensor_and_turns_against_it():
    """The sensor's frame in that of the shape takes the points that one step shows to those of another."""
    drawn = path(1)
    relief = draw_shape(SENSOR, np.random.default_rng(5), PressRanges(size=(0.004, 0.004)), drawn.motion, shapes=("ball",))
    depths, poses = follow_path(relief, drawn, SENSOR)
    tops = []
    for depth, pose in zip(depths, poses, strict=True):
        row, col = np.unravel_index(np.argmin(depth), depth.shape)
        x, y = (col + 0.5) / 64 * SENSOR.width - SENSOR.width / 2, (row + 0.5) / 48 * SENSOR.height - SENSOR.height / 2
        tops.append((pose @ [x, y, depth[row, col], 1])[:3])
    assert np.ptp(tops, axis=0)[:2].max() < 1.5 * SENSOR.width / 64  # the ball's top, to a pixel
    assert np.ptp(tops, axis=0)[2] < 2e-5


def test_patch_is_met_where_its_poses_say():
    """Depth maps of a ball that is made ten times smaller, from the poses of the path."""
    rng, drawn = np.random.default_rng(5), path(2)
    normals = rng.normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ranges = PressRanges(depth=(6e-4, 6e-4), scale=(0.1, 0.1))
    relief = draw_patch(box_faces(ball(4, 0.1)), 0.1 * normals, normals, SENSOR, rng, ranges, drawn.motion)
    depths, poses = follow_path(relief, drawn, SENSOR)
    assert (relief.shape, relief.scale) == ("patch", 0.1)
    small = box_faces(ball(4, 0.01))
    for step in (0, 10, 20, 31):
        np.testing.assert_allclose(depths[step], ray_depth(small, poses[step], SENSOR), atol=1e-9)
        towards = invert_pose(poses[step])[:3, 3]  # the ball's middle in the sensor's frame
        assert towards[2] == pytest.approx(0.01 + SENSOR.w - drawn.depth[step], abs=1e-4)
