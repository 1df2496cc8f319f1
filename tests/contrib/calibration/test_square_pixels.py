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


def deep_mini_presses() -> tuple[list[np.ndarray], np.ndarray, float]:
    """Press a ball of 2.35 mm deeply into a shipped sensor, beyond the slopes that it was calibrated for; its radius in pixels."""
    sensor, rng, ball = vt_pipeline.load_sensor("gelsight_mini", shape=(120, 160)), np.random.default_rng(0), 2.35e-3
    x, y = pixel_centres(sensor)
    images = []
    for _ in range(8):
        middle = rng.uniform(-0.3, 0.3, 2) * (sensor.width, sensor.height)
        height = np.sqrt(np.maximum(ball**2 - (x - middle[0]) ** 2 - (y[:, None] - middle[1]) ** 2, 0))
        pressed = vt_pipeline.press(height - ball, sensor, depth=rng.uniform(1.5e-3, 2e-3)).image
        images.append(np.clip(pressed + rng.normal(0, 1, pressed.shape), 0, 255).round().astype(np.uint8))
    return images, vt_pipeline.untouched_image(sensor), ball / sensor.pitch[1]


@pytest.mark.parametrize("stretch", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("name", SETS)
def test_pixels_must_be_square(name: str, stretch: float) -> None:
    """Deep presses are judged, too; images are resized to 108, 120, and 132 rows."""
    made, untouched = photographs(SETS[name])

    def resized(image: np.ndarray) -> np.ndarray:
        return np.asarray(Image.fromarray(image).resize((160, round(120 * stretch)), Image.Resampling.BILINEAR))

    moved = [Photograph(one.name, resized(one.image), replace(one.contact, y=stretch * (one.contact.y + 0.5) - 0.5)) for one in made]
    if stretch == 1:
        assert check_square(moved, untouched, LARGEST) == []
    else:
        with pytest.raises(InvalidInput, match="% higher than wide" if stretch > 1 else "% wider than high"):
            check_square(moved, resized(untouched), LARGEST)


def test_photographs_that_do_not_show_where_contacts_end_are_used_and_said() -> None:
    """Slopes beyond a sensor's steepest have one colour, and shadows lie beside contacts."""
    images, untouched, largest = deep_mini_presses()
    found = [Photograph(str(number), image, find_contact(image, untouched, largest)) for number, image in enumerate(images)]
    (doubt,) = check_square(found, untouched, largest)
    assert "photographs hardly show where contacts end, nor whether pixels are square" in doubt
