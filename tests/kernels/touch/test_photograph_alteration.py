"""Alterations of photographs: each is found on every sensor that ships, and no press is taken for one."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.photograph_faults import LUMA, Alteration, average, find_alteration, pressed_share, rim_change
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

Image = NDArray[np.uint8]
SENSORS = {
    name: load_sensor(name, shape=shape)
    for name, shape in {"gel_16mm": (60, 60), "gelsight": (60, 80), "gelsight_mini": (60, 80), "digit": (80, 60)}.items()
}


def press(name: str, *, at: tuple[float, float] = (0.1, -0.15), seed: int | None = 0) -> Image:
    """Press a ball of 4 mm radius in by 0.8 mm, at a place in sensor sides, with the noise of a camera."""
    sensor = SENSORS[name]
    x, y = pixel_centres(sensor)
    squared = (x - at[0] * sensor.width) ** 2 + (y[:, None] - at[1] * sensor.height) ** 2
    depth = sensor.w - 0.0008 + 0.004 - np.sqrt(np.maximum(0.004**2 - squared, 0))
    image = tactile_image(np.where(squared < 0.004**2, depth, np.inf), sensor).astype(float)
    return noisy(image, seed)


def noisy(image: NDArray[np.float64] | Image, seed: int | None = 1) -> Image:
    noise = 0 if seed is None else np.random.default_rng(seed).normal(0, 1.5, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def alteration_of(photograph: Image, reference: Image) -> Alteration:
    return find_alteration(average(photograph), average(reference))


def grey(image: Image) -> Image:
    return np.repeat(np.rint(image @ LUMA)[..., None], 3, axis=2).astype(np.uint8)


ALTERED: dict[tuple[str, str], Callable[[Image], Image]] = {
    ("RGB", "upright"): lambda image: image,
    ("BGR", "upright"): lambda image: image[..., ::-1],
    ("grey", "upright"): grey,
    ("RGB", "turned by 180°"): lambda image: image[::-1, ::-1],
    ("RGB", "mirrored left to right"): lambda image: image[:, ::-1],
    ("RGB", "mirrored top to bottom"): lambda image: image[::-1],
    ("RGB", "turned by 90°"): lambda image: np.rot90(image, -1),
    ("RGB", "turned by 270°"): np.rot90,
    ("RGB", "transposed"): lambda image: image.swapaxes(0, 1),
    ("BGR", "turned by 180°"): lambda image: image[::-1, ::-1, ::-1],
}


@pytest.mark.parametrize("expected", ALTERED, ids=" ".join)
@pytest.mark.parametrize("name", SENSORS)
def test_alteration_of_a_press_is_found(name: str, expected: tuple[str, str]) -> None:
    alteration = alteration_of(ALTERED[expected](press(name)), untouched_image(SENSORS[name]))
    assert (alteration.colours, alteration.orientation) == expected
    assert alteration.gain == pytest.approx(1, abs=0.02)
    assert alteration.difference < 2


@pytest.mark.parametrize("gain", [0.7, 0.9, 1.1, 1.4])
@pytest.mark.parametrize("name", SENSORS)
def test_gain_is_measured_beside_a_press(name: str, gain: float) -> None:
    alteration = alteration_of(noisy(gain * press(name).astype(float)), untouched_image(SENSORS[name]))
    assert alteration.is_none
    assert alteration.gain == pytest.approx(gain, abs=0.02)
    assert alteration.difference < 0.3 * alteration.unscaled


def test_gains_by_colour_are_measured() -> None:
    gains = [1.2, 1.0, 0.85]
    alteration = alteration_of(noisy(press("gelsight") * np.array(gains)), untouched_image(SENSORS["gelsight"]))
    assert alteration.is_none
    np.testing.assert_allclose(alteration.gains, gains, rtol=0, atol=0.02)
    assert alteration.balanced < 0.2 * alteration.difference


@pytest.mark.parametrize("name", ["gelsight", "gelsight_mini"])
def test_a_plate_that_tilts_the_whole_gel_is_no_alteration(name: str) -> None:
    sensor = SENSORS[name]
    x, _ = pixel_centres(sensor)
    for slope in (0.05, 0.2, 0.6):
        depth = np.broadcast_to(sensor.w - 0.001 + slope * (x - x[0]), sensor.shape)
        assert alteration_of(tactile_image(depth, sensor), untouched_image(sensor)).is_none


@pytest.mark.parametrize("name", SENSORS)
def test_pressed_photograph_of_two_is_found(name: str) -> None:
    gel = untouched_image(SENSORS[name])
    images = gel, noisy(gel), noisy(gel, 2), press(name), press(name, at=(-0.2, 0.2))
    background, untouched, again, pressed, other = map(average, images)
    assert pressed_share(untouched, pressed, background) == 0
    assert pressed_share(pressed, untouched, background) == 1
    assert 0.2 < pressed_share(pressed, other, background) < 0.8
    assert pressed_share(untouched, again, background) == 0


def test_press_at_the_rim_changes_it() -> None:
    untouched = noisy(untouched_image(SENSORS["gelsight_mini"]))
    assert rim_change(press("gelsight_mini"), untouched) == 0
    assert rim_change(press("gelsight_mini", at=(0.48, 0)), untouched) > 0.03
