"""Deep contacts in gels that are drawn in around them, and contacts cut by the border of the image."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real_touch.hard_sets import HardSet, hard_press, hard_untouched
from pipeline.contrib.calibration.ball_contact import Circle, ball_impression
from pipeline.contrib.calibration.find_contact import find_contact
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

DEEP = HardSet("deep", tail=0.3, shape=(120, 160), mm_per_pixel=0.12)
"""Contacts of 0.8 to 0.98 radii of a ball of 19.6 pixels, around which the gel is drawn in."""


@pytest.mark.parametrize("tail", [0.25, 0.5])
@pytest.mark.parametrize("lamps", ["three", "corners"])
def test_deep_contact_is_found_and_not_the_gel_around_it(tail: float, lamps: str) -> None:
    described = replace(DEEP, tail=tail, lamps=lamps)
    press = hard_press(described, 3)
    found = find_contact(press.image, hard_untouched(described), largest=2.35 / 0.12)
    assert np.hypot(found.x - press.circle.x, found.y - press.circle.y) < 0.15 * press.circle.radius
    assert found.radius == pytest.approx(press.circle.radius, rel=0.12)


def test_contact_is_no_larger_than_the_ball() -> None:
    press = hard_press(DEEP, 3)
    assert find_contact(press.image, hard_untouched(DEEP), largest=12.0).radius <= 12.0


@pytest.fixture(scope="module")
def full_contact() -> tuple[np.ndarray, np.ndarray]:
    """Make a photograph of a contact of 22 pixels radius around (90, 80), and the untouched one."""
    sensor = load_sensor("gelsight").model_copy(update={"rows": 160, "cols": 213, "noise": 1.0})
    pressed = ball_impression(sensor, Circle(90.0, 80.0, 22.0), 0.004)
    return tactile_image(sensor.w - pressed, sensor, np.random.default_rng(0)), untouched_image(sensor)


@pytest.mark.parametrize("seen", [1.7, 1.3, 1.0, 0.85])
@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_contact_cut_by_the_rim_is_found(full_contact: tuple[np.ndarray, np.ndarray], side: str, seen: float) -> None:
    """`seen` radii of its two are in the image."""
    reach = 22.0 * (seen - 1)
    cut = {
        "left": np.s_[:, int(90 - reach) :],
        "right": np.s_[:, : int(91 + reach)],
        "top": np.s_[int(80 - reach) :],
        "bottom": np.s_[: int(81 + reach)],
    }[side]
    image, untouched = (np.ascontiguousarray(one[cut]) for one in full_contact)
    found = find_contact(image, untouched, largest=43)
    x, y = found.x + (int(90 - reach) if side == "left" else 0), found.y + (int(80 - reach) if side == "top" else 0)
    assert np.hypot(x - 90, y - 80) < 0.15 * 22
    assert found.radius == pytest.approx(22, rel=0.15)


@pytest.mark.parametrize("left", [98, 104])
def test_contact_that_lies_mostly_outside_the_image_is_refused(full_contact: tuple[np.ndarray, np.ndarray], left: int) -> None:
    image, untouched = (np.ascontiguousarray(one[:, left:]) for one in full_contact)
    with pytest.raises(InvalidInput, match=r"% of the rim|no circle fits the rim|radius is .* 8 are needed"):
        find_contact(image, untouched, largest=43)


def test_two_balls_in_one_photograph_are_refused() -> None:
    sensor = load_sensor("gelsight").model_copy(update={"rows": 160, "cols": 213, "noise": 1.0})
    both = sum(ball_impression(sensor, Circle(x, y, 20.0), 0.004) for x, y in ((50.0, 60.0), (150.0, 90.0)))
    image = tactile_image(sensor.w - both, sensor, np.random.default_rng(0))
    with pytest.raises(InvalidInput, match=r"and a second one at \(.*photograph one ball at a time"):
        find_contact(image, untouched_image(sensor), largest=68)
