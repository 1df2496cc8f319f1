"""Points of touches: of charts and of gels pressed onto a ball and a slope, in closed form."""

import numpy as np
import pytest

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.sensor import pixel_centres, resample
from pipeline.kernels.touch.touched_points import MOST_ACROSS, SPACING, chart_normals, chart_touches, cloud_touch, gel_touch

RADIUS, PRESSED = 0.02, 1e-3
SENSORS = [resample(load_sensor("gelsight_mini"), 120, 160), load_sensor("gel_16mm"), load_sensor("digit")]
POSE = np.array([[0.0, 0, 1, 0.3], [1, 0, 0, -0.2], [0, 1, 0, 0.5], [0, 0, 0, 1]])
POINT_SIZE = 1e-9 + 2.0**-24  # m of float32 within a metre


def on_ball(sensor):
    """Press a ball into the middle of a gel: its front, m, the contact, and the ball's centre in the sensor frame."""
    x, y = pixel_centres(sensor)
    centre = np.array([0, 0, sensor.w - PRESSED + RADIUS])
    ball = centre[2] - np.sqrt(RADIUS**2 - x[None] ** 2 - y[:, None] ** 2)
    return np.minimum(ball, gel_surface(sensor)), ball < gel_surface(sensor), centre


@pytest.mark.parametrize("sensor", SENSORS, ids=str)
@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_points_of_any_gel_lie_on_the_ball_it_touches_with_normals_away_from_it(sensor, scale):
    front, contact, centre = on_ball(sensor)
    touch, middle = gel_touch(front, contact, sensor, POSE, scale), transform_points(POSE, centre[None])[0]
    spacing = max(SPACING / scale, max(sensor.width, sensor.height) / MOST_ACROSS)
    np.testing.assert_allclose(np.linalg.norm(touch.points - middle, axis=1), RADIUS, atol=spacing**2 / 4 / RADIUS)  # they are means
    outward = (touch.points - middle) / RADIUS
    assert (touch.normals * outward).sum(axis=1).min() > 0.995
    np.testing.assert_allclose(np.linalg.norm(touch.normals, axis=1), 1, atol=1e-6)
    area = contact.sum() * np.prod(sensor.pitch)
    assert area / spacing**2 <= len(touch.points) <= (np.sqrt(area) / spacing + 2) ** 2
    assert touch.touched
    assert touch.width == pytest.approx(sensor.width)
    assert len(touch.free)
    assert np.linalg.norm(touch.free - middle, axis=1).min() > RADIUS - 1e-6
    np.testing.assert_allclose(touch.free_normals, np.broadcast_to(-POSE[:3, 2], touch.free.shape), atol=1e-6)


def test_gel_without_contact_is_free_everywhere():
    sensor = SENSORS[0]
    touch = gel_touch(gel_surface(sensor), np.zeros(sensor.shape, bool), sensor, np.eye(4), 1.0)
    assert not touch.touched
    np.testing.assert_allclose(touch.free[:, 2], sensor.w, atol=1e-6)
    assert np.ptp(touch.free[:, 0]) > 0.8 * sensor.width


def test_a_contact_of_one_pixel_is_a_point():
    sensor = SENSORS[0]
    contact = np.zeros(sensor.shape, bool)
    contact[50, 77] = True
    touch = gel_touch(np.full(sensor.shape, sensor.w), contact, sensor, np.eye(4), 4.0)
    x, y = pixel_centres(sensor)
    np.testing.assert_allclose(touch.points, [[x[77], y[50], sensor.w]], atol=POINT_SIZE)
    np.testing.assert_allclose(touch.normals, [[0, 0, -1]], atol=1e-6)


def test_normals_at_the_rim_of_a_contact_are_those_of_the_surface():
    """A wedge of slope 0.1 along x, beside which the gel is at rest."""
    sensor = SENSORS[1]
    x, _ = pixel_centres(sensor)
    contact = np.broadcast_to(np.abs(x) < 0.003, sensor.shape)
    front = np.where(contact, sensor.w - 1e-3 + 0.1 * x, sensor.w)
    touch = gel_touch(front, contact, sensor, np.eye(4), 1.0)
    np.testing.assert_allclose(touch.normals, np.broadcast_to(np.array([0.1, 0, -1]) / np.hypot(1, 0.1), touch.points.shape), atol=1e-5)


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_moved_touch_is_turned_and_scaled_with_its_gel(scale):
    sensor = SENSORS[0]
    front, contact, _ = on_ball(sensor)
    motion = POSE @ np.diag([scale, scale, scale, 1])
    touch = gel_touch(front, contact, sensor, np.eye(4), 1.0)
    moved = touch.moved(motion)
    assert moved.width == pytest.approx(scale * sensor.width)
    np.testing.assert_allclose(moved.points, transform_points(motion, touch.points), atol=1e-6)
    np.testing.assert_allclose(moved.normals, touch.normals @ POSE[:3, :3].T, atol=1e-6)


def test_points_of_a_cloud_are_as_far_apart_as_those_of_a_gel():
    rng, sensor = np.random.default_rng(0), SENSORS[0]
    points = np.column_stack([rng.uniform(-5e-3, 5e-3, (20_000, 2)), np.full(20_000, sensor.w)])
    touch = cloud_touch(points, np.tile([0.0, 0, -1], (20_000, 1)), sensor, np.eye(4), 4.0, free=np.zeros((0, 3)))
    spacing = sensor.width / MOST_ACROSS
    assert 1e-4 / spacing**2 <= len(touch.points) <= (1e-2 / spacing + 2) ** 2
    assert not len(touch.free)


def test_vertices_of_charts_are_touched_points_and_those_of_squares_free_ones():
    flat = chart_square(5)[0].numpy() * 0.02
    above = np.stack([flat[:, 0], -flat[:, 1], np.full(25, RADIUS)], axis=1)  # of a sensor that looks down: its +z is the world's -z
    chart = RADIUS * above / np.linalg.norm(above, axis=1, keepdims=True)
    touched, untouched = chart_touches(np.stack([chart, above]), np.array([True, False]))
    np.testing.assert_array_equal(touched.points, chart.astype(np.float32))
    np.testing.assert_allclose(touched.normals, chart / RADIUS, atol=0.2)
    np.testing.assert_allclose(touched.normals[12], [0, 0, 1], atol=1e-6)
    assert not untouched.touched
    np.testing.assert_array_equal(untouched.free, above.astype(np.float32))
    np.testing.assert_allclose(untouched.free_normals, np.broadcast_to([0, 0, 1], above.shape), atol=1e-6)
    assert untouched.width == pytest.approx(0.02)
    assert not chart_normals(np.zeros((1, 9, 3))).any()
