"""What is said of altered photographs by `read-touch`, `predict` and `calibrate-sensor`: each fault with its remedy; right ones pass."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from pipeline.contrib.calibration.ball_contact import Circle, ball_impression
from pipeline.contrib.calibration.ball_photographs import read_photographs
from pipeline.contrib.calibration.calibrate_sensor import uncalibrated_sensor
from pipeline.contrib.calibration.colour_fit import fit_background
from pipeline.contrib.calibration.square_pixels import check_square
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.photograph_faults import photograph_faults, untouched_faults
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.real_touch import TouchReader
from pipeline.reconstruct.observation_checks import check
from tests.command_line import vt
from tests.kernels.touch.test_photograph_alteration import SENSORS, grey, noisy, press
from tests.reconstruct.robot import write_files, write_observation

Pixels = NDArray[np.uint8]


def turned_hue(angle: float) -> NDArray[np.float64]:
    """Return the matrix that turns colours about grey, degrees."""
    shift = np.roll(np.eye(3), 1, axis=1)
    cosine, sine = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)) / np.sqrt(3)
    return np.asarray(cosine * np.eye(3) + (1 - cosine) / 3 + sine * (shift - shift.T))


FAULTS: dict[str, tuple[Callable[[Pixels], Pixels], str]] = {
    "bgr": (lambda image: image[..., ::-1], r"colours exchanged \(blue, green, red\): save it as red, green, blue"),
    "green and red": (lambda image: image[..., [1, 0, 2]], r"colours exchanged \(green, red, blue\)"),
    "180": (lambda image: image[::-1, ::-1], "turned by 180°: turn it back"),
    "mirrored": (lambda image: image[:, ::-1], "mirrored left to right: mirror it back"),
    "upside down": (lambda image: image[::-1], "mirrored top to bottom: mirror it back"),
    "90": (lambda image: np.rot90(image, -1), "turned by 90°: turn it back"),
    "grey": (grey, "grey: take it in colour"),
    "brighter": (lambda image: noisy(1.3 * image.astype(float), None), r"exposure differs by (29|30) % \(brighter\): fix the camera's"),
    "darker": (lambda image: noisy(0.7 * image.astype(float), None), r"exposure differs by 30 % \(darker\): fix the camera's exposure"),
    "dark": (lambda image: np.zeros_like(image), r"exposure differs by 100 % \(darker\)"),
    "balance": (
        lambda image: noisy(image * np.array([1.25, 1, 0.8]), None),
        r"white balance differs \(red \+2\d %, green .*: fix the camera's",
    ),
    "contrast": (lambda image: noisy(1.3 * image.astype(float) - 34, None), r"colours are \d+ % stronger: fix the camera's contrast"),
    "saturation": (lambda image: noisy(0.5 * image.astype(float) + 0.5 * grey(image).astype(float), None), r"colours are (4|5)\d % weaker"),
    "hue": (lambda image: noisy(np.asarray(image @ turned_hue(30), np.float64), None), r"hue differs by (2|3)\d°: fix the camera's"),
    "bgr, balance": (
        lambda image: noisy(image[..., ::-1] * np.array([1.25, 1, 0.8]), None),
        r"colours exchanged \(blue, green, red\).*white balance differs",
    ),
}
HIDDEN = ("contrast", "bgr, balance")
"""Those that a press hides in the gelsight, whose colours are weak."""
SHOWN = ("bgr", "180", "mirrored", "90", "grey", "brighter", "dark", "balance", "saturation", "hue")
NAME, BACKGROUND = "gelsight", untouched_image(SENSORS["gelsight"])


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_of_both_photographs_is_named_by_the_untouched_one(fault: str) -> None:
    alter, message = FAULTS[fault]
    with pytest.raises(InvalidInput, match=f"background of sensor gelsight: {message}.*go on with --accept-photographs"):
        TouchReader(NAME, np.ascontiguousarray(alter(noisy(BACKGROUND))))


@pytest.fixture(scope="module")
def reader() -> TouchReader:
    return TouchReader(NAME, noisy(BACKGROUND))


@pytest.mark.parametrize("fault", SHOWN)
def test_fault_of_the_touched_photograph_alone_is_named(reader: TouchReader, fault: str) -> None:
    alter, message = FAULTS[fault]
    with pytest.raises(InvalidInput, match=f"the photograph, compared with the untouched one: {message}"):
        reader.read(np.ascontiguousarray(alter(press(NAME))))


@pytest.mark.parametrize("fault", HIDDEN)
def test_fault_beside_a_press_is_named_where_the_gel_has_strong_colours(fault: str) -> None:
    alter, message = FAULTS[fault]
    untouched = noisy(untouched_image(SENSORS["gelsight_mini"]))
    faults = photograph_faults(alter(press("gelsight_mini")), untouched, SENSORS["gelsight_mini"])
    assert re.search(message, "; ".join(faults))


def test_exchanged_photographs_are_named(reader: TouchReader) -> None:
    exchanged = TouchReader(NAME, press(NAME))
    with pytest.raises(InvalidInput, match="the untouched photograph shows a contact, and the photograph does not: exchange them"):
        exchanged.read(reader.untouched)
    with pytest.raises(InvalidInput, match="the untouched photograph shows a contact too"):
        exchanged.read(press(NAME, at=(-0.2, 0.2)))


def test_accepted_photographs_are_read() -> None:
    accepting = TouchReader(NAME, press(NAME)[..., ::-1], accept_photographs=True)
    assert accepting.read(noisy(BACKGROUND)).indentation.shape == SENSORS[NAME].shape


@pytest.mark.parametrize("name", SENSORS)
def test_right_photographs_have_no_fault(name: str) -> None:
    sensor = SENSORS[name]
    untouched = noisy(untouched_image(sensor))
    assert untouched_faults(untouched, sensor) == []
    for at in [(0.0, 0.0), (-0.3, 0.2), (0.48, 0.1)]:
        assert photograph_faults(press(name, at=at), untouched, sensor) == []
        assert photograph_faults(press(name, at=at), None, sensor) == []
        assert photograph_faults(press(name, at=at), untouched) == []
    assert photograph_faults(noisy(untouched_image(sensor), 2), untouched, sensor) == []


@pytest.mark.parametrize("other", [name for name in SENSORS if name != NAME])
def test_untouched_photograph_of_another_sensor_is_named(other: str) -> None:
    rows, cols = SENSORS[NAME].shape
    untouched = untouched_image(load_sensor(other, shape=(rows, cols)))
    (fault,) = untouched_faults(untouched, SENSORS[NAME])
    assert "does not look like the background of sensor gelsight: they differ by" in fault
    assert "name the file of its own sensor, or calibrate it" in fault


@pytest.mark.parametrize("degree", [0, 2, 4])
def test_photographs_suit_a_file_with_a_simple_background(degree: int) -> None:
    sensor = SENSORS["gelsight_mini"]
    assert sensor.calibrated is not None
    untouched = noisy(untouched_image(sensor))
    background = tuple(map(tuple, fit_background(untouched, sensor, degree)))
    simple = Sensor.model_validate(sensor.model_dump() | {"calibrated": sensor.calibrated.model_dump() | {"background": background}})
    assert untouched_faults(untouched, simple) == []
    assert photograph_faults(press("gelsight_mini"), untouched, simple) == []
    if degree:  # the mean colours alone do not say it
        assert "colours exchanged" in str(untouched_faults(untouched[..., ::-1], simple))


def test_rim_is_pressed_where_the_photograph_shows_it(reader: TouchReader) -> None:
    assert not reader.read(noisy(BACKGROUND, 2)).rim_pressed
    assert reader.read(press(NAME, at=(0.45, 0))).rim_pressed


def test_command_stops_before_it_reads_and_goes_on_if_told(tmp_path: Path) -> None:
    files = {"untouched": noisy(BACKGROUND)[..., ::-1], "touch": press(NAME, at=(0.45, 0))[..., ::-1]}
    for name, image in files.items():
        Image.fromarray(np.ascontiguousarray(image)).save(tmp_path / f"{name}.png")
    command = ["read-touch", tmp_path / "touch.png", "--untouched", tmp_path / "untouched.png", "--sensor", NAME]
    stopped = vt(*command, fails=True)
    assert "colours exchanged (blue, green, red)" in stopped
    assert "deepest" not in stopped
    assert "per second" not in stopped
    assert "the rim is pressed" in vt(*command, "--accept-photographs")


def test_command_reads_the_others_of_a_folder_and_names_all_that_failed(tmp_path: Path) -> None:
    (tmp_path / "photographs").mkdir()
    images = {"a": press(NAME)[..., ::-1], "b": press(NAME), "c": press(NAME)[:, :-3], "d": press(NAME)[::-1]}
    for name, image in images.items():
        Image.fromarray(np.ascontiguousarray(image)).save(tmp_path / "photographs" / f"{name}.png")
    (tmp_path / "photographs" / "e.png").write_text("no image")
    Image.fromarray(noisy(BACKGROUND)).save(tmp_path / "untouched.png")
    command = ["read-touch", tmp_path / "photographs", "--untouched", tmp_path / "untouched.png", "--sensor", NAME]
    said = vt(*command, fails=True)
    assert "b: deepest" in said
    failed = ["a: the photograph, .* colours", "c: it has 77 x 60 pixels", "d: .* mirrored", r"e: .*e\.png"]
    assert re.search(".*".join(["4 photographs failed:", *failed]), said)


def test_observation_names_altered_tactile_images_or_accepts_them(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    untouched = noisy(untouched_image(SENSORS["gel_16mm"]))
    images = {"untouched": untouched, "index": press("gel_16mm"), "thumb": press("gel_16mm")[..., ::-1]}
    for name, image in images.items():
        Image.fromarray(np.ascontiguousarray(image)).save(tmp_path / f"{name}.png")
    path = write_observation(tmp_path, entries | {"untouched": "untouched.png"})
    with pytest.raises(InvalidInput) as error:
        check(path)
    assert "touches.1, compared with the untouched one: colours exchanged" in str(error.value)
    assert "touches.0" not in str(error.value)
    assert "add accept_photographs: true" in str(error.value)
    check(write_observation(tmp_path, entries | {"untouched": "untouched.png", "accept_photographs": True}))
    with pytest.raises(InvalidInput, match=r"touches\.1, compared with the background of sensor gel_16mm: colours exchanged"):
        check(write_observation(tmp_path, entries))
    path = write_observation(tmp_path, entries | {"untouched": "untouched.png"})
    Image.fromarray(np.ascontiguousarray(untouched[::-1, ::-1])).save(tmp_path / "untouched.png")
    with pytest.raises(InvalidInput, match=r"the untouched photograph, .*: turned by 180°"):
        check(path)


def write_presses(folder: Path, alter: Callable[[Pixels, int], Pixels]) -> None:
    """Write an untouched photograph and four presses of the Mini, twice as large."""
    for number, at in enumerate([(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2)]):
        Image.fromarray(np.ascontiguousarray(alter(press("gelsight_mini", at=at, seed=number), number))).save(folder / f"{number}.png")
    Image.fromarray(noisy(untouched_image(SENSORS["gelsight_mini"]))).save(folder / "untouched.png")


@pytest.mark.parametrize(
    ("alter", "message"),
    [
        (lambda image, number: image[..., ::-1], "0.png, compared with the untouched one: colours exchanged"),
        (
            lambda image, number: noisy((1, 1, 1.2, 0.8)[number] * image.astype(float), None),
            r"^2.png, .*20 % \(brighter\).*; 3.png, .*darker",
        ),
    ],
)
def test_calibration_names_altered_photographs(tmp_path: Path, alter: Callable[[Pixels, int], Pixels], message: str) -> None:
    write_presses(tmp_path, alter)
    with pytest.raises(InvalidInput, match=message):
        read_photographs(tmp_path, tmp_path / "untouched.png", largest=100)


def test_contacts_that_are_ellipses_need_the_height_of_a_pixel(tmp_path: Path) -> None:
    """Rows are a tenth higher than columns are wide: contacts are found where they are, with a radius along x."""
    true = load_sensor("gelsight_mini", shape=(166, 240))
    sensor = true.model_copy(update={"given_height": 1.1 * 166 / 240 * true.width, "gel": None})
    contacts = [Circle(x, y, 28) for x in (60.0, 170.0) for y in (50.0, 110.0)]
    for number, contact in enumerate(contacts):
        depth = sensor.w - ball_impression(sensor, contact, 0.004)
        Image.fromarray(noisy(tactile_image(depth, sensor), number)).save(tmp_path / f"{number}.png")
    Image.fromarray(untouched_image(sensor)).save(tmp_path / "untouched.png")
    photographs, untouched, _ = read_photographs(tmp_path, tmp_path / "untouched.png", 0.004 / sensor.pitch[1])
    with pytest.raises(InvalidInput, match=r"contacts are \d+ % wider than high, in pixels .*add --mm-per-row: .* 1\.(09|10|11)\d times"):
        check_square(photographs, untouched, 0.004 / sensor.pitch[1])
    photographs, _, unusable = read_photographs(tmp_path, tmp_path / "untouched.png", 0.004 / sensor.pitch[1], row_scale=1.1)
    assert unusable == {}
    for photograph, contact in zip(photographs, contacts, strict=True):
        found = photograph.contact
        np.testing.assert_allclose([found.x, found.y], [contact.x, contact.y], rtol=0, atol=2)
        assert found.radius == pytest.approx(contact.radius, rel=0.1)
    assert uncalibrated_sensor("mine", (166, 240), pitch=1e-4, thickness=0.004, row_scale=1.1).height == pytest.approx(166 * 1.1e-4)
