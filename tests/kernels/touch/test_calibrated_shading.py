"""Calibrated optics: the polynomial against a plain one, membrane and shadow against closed forms, and pixel noise."""

import numpy as np
import pytest

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.calibrated_shading import indentation_change, polynomial_background, powers, shade_depth
from pipeline.kernels.touch.depth_maps import membrane_indentation
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

SMALL = load_sensor("gelsight").model_copy(update={"rows": 48, "cols": 64, "membrane": 0.0009, "gel": None})


def bump(sensor=SMALL, radius=0.003, deep=0.001) -> np.ndarray:
    x, y = np.meshgrid(*pixel_centres(sensor))
    return np.maximum(deep * (1 - (x**2 + y**2) / radius**2), 0)


def slow_change(sensor, pressed) -> np.ndarray:
    """Evaluate the polynomial, pixel by pixel, without membrane and shadows."""
    x, y = (centres / sensor.width for centres in pixel_centres(sensor))
    left, top, right, bottom = np.array(sensor.calibrated.within) / sensor.width
    x, y = ([min(max(at, least), most) for at in axis] for axis, least, most in ((x, left, right), (y, top, bottom)))
    change = np.zeros((*sensor.shape, 3))
    rows, cols = sensor.shape
    for r in range(rows):
        for c in range(cols):
            left, right, above, below = max(c - 1, 0), min(c + 1, cols - 1), max(r - 1, 0), min(r + 1, rows - 1)
            slope = np.array(
                [
                    (pressed[r, right] - pressed[r, left]) / ((right - left) * sensor.pitch[1]),
                    (pressed[below, c] - pressed[above, c]) / ((below - above) * sensor.pitch[0]),
                ]
            )
            a, b = tilt = slope / np.sqrt(1 + slope @ slope)
            if (size := np.linalg.norm(tilt)) > sensor.calibrated.steepest:
                a, b = tilt / size * sensor.calibrated.steepest
            normal = [a**i * b**j for i, j in powers(3)[1:]]
            place = [x[c] ** i * y[r] ** j for i, j in powers(2)]
            change[r, c] = np.einsum("csp,s,p->c", np.array(sensor.calibrated.coefficients), normal, place)
            if sensor.calibrated.depth is not None:
                change[r, c] += 1e3 * min(pressed[r, c], sensor.calibrated.deepest) * np.array(sensor.calibrated.depth) @ place
    return change


TERMS = np.random.default_rng(0).normal(0, 9, (3, 6)).tolist()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"depth": TERMS, "deepest": 10.0},
        {"depth": TERMS, "deepest": 0.0006},
        {"depth": None, "steepest": 0.05},
        {"within": (-0.001, -0.0008, 0.0012, 0.0009)},
    ],
    ids=str,
)
def test_colours_are_the_polynomial_of_normal_depth_and_position_within_the_fitted_range(changes) -> None:
    optics = SMALL.calibrated.model_copy(update={"shadows": (), **changes})
    sensor = SMALL.model_copy(update={"membrane": 0.0, "calibrated": optics})
    pressed = bump() + 0.0004 * np.eye(48, 64)[::-1]
    np.testing.assert_allclose(indentation_change(pressed, sensor, optics), slow_change(sensor, pressed), atol=1e-9)
    assert (indentation_change(np.zeros(sensor.shape), sensor, optics) == 0).all()


def test_contact_deeper_than_the_fitted_range_casts_the_shadow_of_the_deepest() -> None:
    optics = SMALL.calibrated.model_copy(update={"deepest": 0.0006})
    no_shadow, no_limit = optics.model_copy(update={"shadows": ()}), optics.model_copy(update={"deepest": 10.0})
    sensor, deep = SMALL.model_copy(update={"membrane": 0.0}), bump()
    cast = indentation_change(deep, sensor, optics) - indentation_change(deep, sensor, no_shadow)
    cut = np.minimum(deep, 0.0006)
    expected = indentation_change(cut, sensor, no_limit) - indentation_change(cut, sensor, no_shadow)
    np.testing.assert_allclose(cast, expected, atol=1e-9)


def test_untouched_image_is_the_background_polynomial() -> None:
    terms = SMALL.calibrated.background
    x, y = (centres / SMALL.width for centres in pixel_centres(SMALL))
    expected = sum(x[5] ** i * y[7] ** j * np.array(levels) for (i, j), levels in zip(powers(6), terms, strict=True))
    np.testing.assert_allclose(polynomial_background(SMALL, terms)[7, 5], expected)
    assert (untouched_image(SMALL)[7, 5] == np.rint(expected)).all()


def test_membrane_is_isotropic_keeps_the_volume_and_has_the_set_width() -> None:
    """The indentation around one point sums to it and is isotropic with the set standard deviation."""
    point = np.zeros((121, 141))
    point[60, 70] = 1.0
    around = membrane_indentation(point, (5.0, 7.0))
    around[60, 70] = 0.25 * sum(around[60 + i, 70 + j] for i, j in ((0, 1), (1, 0), (0, -1), (-1, 0)))  # the point's own is its depth
    rows, cols = np.indices(point.shape)
    assert around.sum() == pytest.approx(1, rel=0.01)
    assert np.sqrt((around * (rows - 60) ** 2).sum()) == pytest.approx(5, rel=0.02)
    assert np.sqrt((around * (cols - 70) ** 2).sum()) == pytest.approx(7, rel=0.02)
    distance = np.hypot((rows - 60) / 5, (cols - 70) / 7)
    ring = around[(distance > 1.95) & (distance < 2.05)]
    assert ring.max() < 2 * ring.min()
    assert (membrane_indentation(point, (5.0, 7.0)) >= point).all()


def test_membrane_is_two_exponential_filters_along_both_axes(rng) -> None:
    """Two-sided filters with the response decay^|distance|, as sums over all pixels; 80 columns are more than are smoothed at once."""
    pressed = np.maximum(rng.normal(size=(30, 80)) - 1, 0)
    smooth = pressed
    for axis, sigma in ((0, 5.0), (1, 7.0)):
        decay, places = np.exp(-2 / sigma), np.arange(pressed.shape[axis])
        response = (1 - decay) / (1 + decay) * decay ** np.abs(places[:, None] - places)
        for _ in range(2):
            smooth = np.moveaxis(np.tensordot(response, smooth, axes=(1, axis)), 0, axis)
    np.testing.assert_allclose(membrane_indentation(pressed, (5.0, 7.0)), np.maximum(pressed, smooth), atol=1e-12)


def test_shadow_of_a_wall_is_as_long_as_its_height_over_the_slope() -> None:
    """A wall of 1 mm on one column; light from the left at slope 0.5: the shade begins behind it and ends 2 mm further."""
    wall = np.zeros((20, 60))
    wall[:, 20] = 0.001
    shade = shade_depth(wall, (1e-4, 1e-4), direction=np.pi, slope=0.5)
    assert (shade[:, :21] == 0).all()
    np.testing.assert_allclose(shade[10, 21:41], 0.001 - 0.5e-4 * np.arange(1, 21), atol=1e-15)
    assert (shade[:, 41:] == 0).all()
    np.testing.assert_allclose(shade_depth(wall[:, ::-1], (1e-4, 1e-4), direction=0.0, slope=0.5), shade[:, ::-1], atol=1e-15)
    np.testing.assert_allclose(shade_depth(wall.T.copy(), (1e-4, 1e-4), direction=-np.pi / 2, slope=0.5), shade.T, atol=1e-15)


def test_noise_has_the_set_standard_deviation_and_needs_a_generator() -> None:
    noisy = SMALL.model_copy(update={"noise": 2.0})
    empty = np.full(SMALL.shape, np.inf)
    still = tactile_image(empty, noisy)
    assert (still == untouched_image(SMALL)).all()
    drawn = tactile_image(empty, noisy, np.random.default_rng(0)).astype(float) - still
    assert drawn.std() == pytest.approx(2.0, rel=0.05)
    assert (tactile_image(empty, noisy, np.random.default_rng(0)) == tactile_image(empty, noisy, np.random.default_rng(0))).all()
    assert (tactile_image(empty, SMALL, np.random.default_rng(0)) == still).all()
