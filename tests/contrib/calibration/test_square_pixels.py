"""The height of a pixel over its width, in deep and shallow presses."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import vt_pipeline
from benchmarks.real_touch.hard_sets import HardSet, hard_press, hard_untouched
from pipeline.contrib.calibration.ball_contact import Photograph
from pipeline.contrib.calibration.find_contact import find_contact
from pipeline.contrib.calibration.square_pixels import check_square
from pipeline.errors import InvalidInput
from pipeline.kernels.touch.sensor import pixel_centres

SETS = {
    "short skirt": HardSet("short skirt", tail=0.25, shape=(120, 160), mm_per_pixel=0.12),
    "long skirt": HardSet("long skirt", tail=0.6, lamps="corners", shape=(120, 160), mm_per_pixel=0.12),
    "elastic": HardSet("elastic", tail=None, reach=(0.7, 0.8), shape=(120, 160), mm_per_pixel=0.12),
}
LARGEST = 2.35 / 0.12
"""Radius of the ball, pixels."""


def photographs(described: HardSet) -> tuple[list[Photograph], np.ndarray]:
    """Press a ball at eight places."""
    presses = [hard_press(described, number) for number in range(8)]
    made = [Photograph(str(number), press.image, press.circle) for number, press in enumerate(presses)]
    return made, hard_untouched(described)


def mini_photographs(ball: float, depths: tuple[float, float], rows: int) -> tuple[list[Photograph], np.ndarray, float]:
    """Press a ball, m, into a shipped sensor at eight places, and find its contacts in images of so many rows; its radius in pixels."""
    sensor, rng = vt_pipeline.load_sensor("gelsight_mini", shape=(120, 160)), np.random.default_rng(0)
    (x, y), largest = pixel_centres(sensor), ball / sensor.pitch[1]
    untouched, made = resized(vt_pipeline.untouched_image(sensor), rows), []
    for number in range(8):
        middle = rng.uniform(-0.3, 0.3, 2) * (sensor.width, sensor.height)
        height = np.sqrt(np.maximum(ball**2 - (x - middle[0]) ** 2 - (y[:, None] - middle[1]) ** 2, 0))
        pressed = vt_pipeline.press(height - ball, sensor, depth=rng.uniform(*depths)).image
        noisy = np.clip(pressed + rng.normal(0, 1, pressed.shape), 0, 255).round().astype(np.uint8)
        image = resized(noisy, rows)
        made.append(Photograph(str(number), image, find_contact(image, untouched, largest)))
    return made, untouched, largest


def resized(image: np.ndarray, rows: int) -> np.ndarray:
    return np.asarray(Image.fromarray(image).resize((160, rows), Image.Resampling.BILINEAR))


@pytest.mark.parametrize("rows", [108, 120, 132])
@pytest.mark.parametrize("name", SETS)
def test_pixels_must_be_square_in_deep_presses(name: str, rows: int) -> None:
    made, untouched = photographs(SETS[name])
    circles = [replace(one.contact, y=rows / 120 * (one.contact.y + 0.5) - 0.5) for one in made]
    moved = [Photograph(one.name, resized(one.image, rows), circle) for one, circle in zip(made, circles, strict=True)]
    check(moved, resized(untouched, rows), LARGEST, rows)


@pytest.mark.parametrize("rows", [108, 120, 132])
def test_pixels_must_be_square_in_gentler_presses_of_a_shipped_sensor(rows: int) -> None:
    check(*mini_photographs(0.004, (0.45e-3, 1.5e-3), rows), rows)


def check(made: list[Photograph], untouched: np.ndarray, largest: float, rows: int) -> None:
    if rows == 120:
        assert check_square(made, untouched, largest) == []
    else:
        with pytest.raises(InvalidInput, match="% higher than wide" if rows > 120 else "% wider than high"):
            check_square(made, untouched, largest)


def test_photographs_that_do_not_show_where_contacts_end_are_used_and_said() -> None:
    """Slopes beyond a sensor's steepest have one colour, and shadows lie beside contacts."""
    (doubt,) = check_square(*mini_photographs(2.35e-3, (1.5e-3, 2e-3), 120))
    assert "photographs hardly show where contacts end, nor whether pixels are square" in doubt
