"""Presses of the library: reliefs, objects to a depth, elastic gels."""

import numpy as np
import pytest
import trimesh

import vt_pipeline as vt
from pipeline.kernels.touch.sensor import Gel, pixel_centres
from tests.kernels.touch.shapes import pose_at

SENSOR = vt.load_sensor("gelsight", shape=(120, 160)).model_copy(update={"membrane": 0.0009, "gel": None})
RADIUS = 0.004
MESH = trimesh.creation.icosphere(subdivisions=6, radius=RADIUS)
BALL = vt.load_object((MESH.vertices, MESH.faces))
X, Y = np.meshgrid(*pixel_centres(SENSOR))
RELIEF = np.sqrt(np.maximum(RADIUS**2 - X**2 - Y**2, 0)) - np.where(np.hypot(X, Y) < RADIUS, 0, np.inf)
ELASTIC = SENSOR.model_copy(update={"membrane": 0.0, "gel": Gel(modulus=2e5, thickness=10.0)})


def facing(distance: float) -> np.ndarray:
    return pose_at(np.zeros(3), np.array([0.0, 0.6, 0.8]), distance)


def test_relief_and_mesh_of_one_shape_give_the_same_touch():
    relief, ball = vt.press(RELIEF, SENSOR, depth=6e-4), vt.press(BALL, SENSOR, facing(0.012), depth=6e-4)
    deep = relief.contact & ball.contact
    assert deep.sum() > 0.95 * relief.contact.sum()
    np.testing.assert_allclose(relief.depth[deep], ball.depth[deep], atol=3e-6)  # facets of the mesh
    assert np.linalg.norm(ball.pose[:3, 3]) == pytest.approx(RADIUS + SENSOR.w - 6e-4, abs=3e-6)
    assert relief.success
    assert ball.success
    assert (relief.image == vt.image(relief.depth, SENSOR)).all()
    assert relief.contact_area == pytest.approx(np.pi * (2 * RADIUS * 6e-4 - 6e-4**2), rel=0.02)
    assert relief.gel.contact.sum() <= relief.contact.sum()


def test_only_elastic_gels_give_pressure_and_force():
    touch, deeper = vt.press(RELIEF, ELASTIC, depth=5e-4), vt.press(RELIEF, ELASTIC, depth=6e-4)
    stiff = 2e5 / (1 - 0.48**2)
    assert touch.force == pytest.approx(4 / 3 * stiff * np.sqrt(RADIUS) * 5e-4**1.5, rel=0.05)  # Hertz has a paraboloid, not a ball
    assert deeper.force > touch.force
    assert touch.pressure.sum() * np.prod(ELASTIC.pitch) == pytest.approx(touch.force)
    assert touch.contact_area == pytest.approx(np.pi * RADIUS * 5e-4, rel=0.06)  # half the area that the ball cuts out of the gel's plane
    assert len(touch.points) == (touch.pressure > 0).sum()
    with pytest.raises(vt.InvalidInput, match="sensor gelsight has no elastic gel, so pressure is unknown; give its file `gel:"):
        _ = vt.press(RELIEF, SENSOR, depth=5e-4).force


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: vt.press(RELIEF, SENSOR), TypeError, "give its depth and no pose"),
        (lambda: vt.press(RELIEF, SENSOR, np.eye(4), depth=1e-3), TypeError, "give its depth and no pose"),
        (lambda: vt.press(BALL, SENSOR, depth=1e-3), TypeError, "an object needs a pose"),
        (lambda: vt.press(RELIEF.T, SENSOR, depth=1e-3), vt.InvalidInput, r"relief has shape \(160, 120\)"),
        (lambda: vt.press(RELIEF[None], SENSOR, depth=1e-3), TypeError, r"a relief is an array \(rows, cols\) of numbers"),
        (lambda: vt.press(RELIEF, SENSOR, depth=0.01), vt.InvalidInput, "depth is 0.01 m; a press .* less than the gel"),
        (lambda: vt.press(BALL, SENSOR, facing(1.0), depth=1e-3), vt.InvalidInput, "no surface lies within 0.02 m in front of the pose"),
        (lambda: vt.press(BALL, SENSOR, facing(0.012), depth=0.01), vt.InvalidInput, "depth is 0.01 m"),
        (lambda: vt.press(BALL, SENSOR, facing(0.003), depth=1e-3), vt.InvalidInput, "part of the object begins behind the pose's plane"),
        (lambda: vt.press(BALL, SENSOR, 2 * np.eye(4), depth=1e-3), vt.InvalidInput, "not a rigid motion"),
        (lambda: vt.image(np.zeros((3, 3)), SENSOR), vt.InvalidInput, r"depth of shape \(3, 3\)"),
        (lambda: vt.image(np.full(SENSOR.shape, np.nan), SENSOR), vt.InvalidInput, "NaN"),
        (lambda: vt.image([[0.0]], SENSOR), TypeError, r"depth is an array \(rows, cols\) of numbers; this is list"),
        (lambda: vt.load_sensor("gelsight", shape=(1, 1)), vt.InvalidInput, "these are 1 x 1"),
    ],
)
def test_what_cannot_be_pressed_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call()
