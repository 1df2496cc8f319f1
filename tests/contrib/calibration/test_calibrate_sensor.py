"""`calibrate-sensor` on rendered photographs of a known model: it recovers the model, finds circles and names bad photographs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.real_touch.hard_sets import HardSet, hard_press, hard_untouched
from pipeline.contrib.calibration.ball_contact import Circle, ball_impression
from pipeline.contrib.calibration.ball_photographs import read_photographs
from pipeline.contrib.calibration.calibrate_sensor import check_name
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor, sensor_files
from pipeline.kernels.touch.markers import MarkerGrid
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import background, tactile_image, untouched_image
from pipeline.real_touch import TouchReader
from tests.command_line import vt

BALL = 0.002
TRUE = load_sensor("gelsight").model_copy(update={"rows": 160, "cols": 213, "noise": 1.0, "membrane": 0.0009, "gel": None})

LARGEST = BALL / TRUE.pitch[1]
"""Radius of the ball, pixels."""


def photograph(contact: Circle, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    return tactile_image(sensor.w - ball_impression(sensor, contact, BALL), sensor, rng)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write photographs of ten contacts, one without contact, one of another size, and a file that is not an image."""
    rng, path = np.random.default_rng(0), tmp_path_factory.mktemp("photographs")
    untouched = path.parent / "untouched.png"
    Image.fromarray(untouched_image(TRUE)).save(untouched)
    lines = []
    for number in range(10):
        contact = Circle(rng.uniform(50, 160), rng.uniform(50, 110), rng.uniform(17, 20))
        Image.fromarray(photograph(contact, TRUE, rng)).save(path / f"{number}.png")
        lines.append(f"{number}.png {contact.x} {contact.y} {contact.radius}")
    (path.parent / "contacts.txt").write_text("\n".join(lines))
    Image.fromarray(untouched_image(TRUE)).save(path / "nothing.png")
    Image.fromarray(untouched_image(TRUE)[:50]).save(path / "small.png")
    (path / "torn.png").write_text("no image")
    return path


def test_circles_are_found_within_a_pixel_and_bad_photographs_are_named(folder: Path) -> None:
    photographs, untouched, unusable = read_photographs(folder, folder.parent / "untouched.png", LARGEST)
    assert set(unusable) == {"nothing.png", "small.png", "torn.png"}
    assert "nothing touches" in unusable["nothing.png"]
    assert "it has 50 x 213 pixels, the untouched photograph 160 x 213" in unusable["small.png"]
    assert untouched.shape == (160, 213, 3)
    rows = [line.split() for line in (folder.parent / "contacts.txt").read_text().splitlines()]
    true = {name: np.array(numbers, float) for name, *numbers in rows}
    for photograph_read in photographs:
        error = np.abs([photograph_read.contact.x, photograph_read.contact.y, photograph_read.contact.radius] - true[photograph_read.name])
        assert error.max() < 1.0, (photograph_read.name, error)


def test_a_known_model_is_recovered(folder: Path, tmp_path: Path) -> None:
    """Colours of a contact that was not photographed are right to two levels."""
    (folder / "circles.csv").write_text(
        "name,x,y,radius\n" + "\n".join(",".join(line.split()) for line in (folder.parent / "contacts.txt").read_text().splitlines())
    )
    out, untouched = tmp_path / "mine.yaml", folder.parent / "untouched.png"
    (tmp_path / "thesis.txt").write_text("mine")
    for name in ("mine.yaml", "mine-calibration.png", "mine-untouched.png"):
        (tmp_path / name).symlink_to(tmp_path / "thesis.txt")
    size = ["--ball-radius", "2", "--mm-per-pixel", str(1e3 * TRUE.pitch[1]), "--untouched", str(untouched)]
    printed = vt("calibrate-sensor", folder, out, *size, "--shadows", 3)
    (folder / "circles.csv").unlink()
    assert "not used: nothing.png: nothing touches" in printed
    assert out.with_name("mine-calibration.png").stat().st_size > 10_000
    assert (tmp_path / "thesis.txt").read_text() == "mine"  # links were replaced
    mine = load_sensor(out)
    assert [path.name for path in sensor_files([str(out)])] == ["mine.yaml", "mine-untouched.png"]
    assert (background(mine, mine.calibrated) == untouched_image(TRUE)).all()
    assert "missing: no contact in the upper left, " in printed
    assert mine.calibrated.within is not None
    assert -0.0095 < mine.calibrated.within[0] < mine.calibrated.within[2] < 0.0095
    assert 0.0003 < mine.calibrated.deepest < 0.004
    assert mine.membrane == pytest.approx(TRUE.membrane, rel=0.2)
    contact, rng = Circle(100.0, 80.0, 16.0), None
    pressed = [tactile_image(sensor.w - ball_impression(sensor, contact, BALL), sensor, rng).astype(float) for sensor in (mine, TRUE)]
    error = np.abs(pressed[0] - pressed[1])
    change = np.abs(pressed[1] - untouched_image(TRUE)).max(axis=2) > 5
    assert error[change].mean() < 2.0 < np.abs(pressed[1] - untouched_image(TRUE))[change].mean()
    assert error.mean() < 1.0


def test_unusable_photographs_are_refused_with_the_reason(folder: Path, tmp_path: Path) -> None:
    (few := tmp_path / "few").mkdir()
    (few / "0.png").write_bytes((folder / "0.png").read_bytes())
    for place, circles, message in (
        (tmp_path / "none", None, "does not exist"),
        (few, None, "has 1 usable photograph, 4 are needed"),
        (few, "name,x\n0.png,1\n", "needs the columns name, x, y, radius"),
    ):
        if circles:
            (place / "circles.csv").write_text(circles)
        with pytest.raises(InvalidInput, match=message):
            read_photographs(place, folder.parent / "untouched.png", LARGEST)


@pytest.mark.parametrize(
    ("name", "untouched", "message"),
    [
        ("my_gel.yaml", "my_gel-calibration.png", "my_gel-calibration.png would be replaced by a picture of .*my_gel.yaml; rename"),
        ("my_gel.yaml", "my_gel.png", "my_gel.png would be replaced by a picture"),
        *((name, "untouched.png", "a sensor file is called NAME.yaml") for name in ("my sensor.yaml", "mine.png", "mine")),
    ],
)
def test_invalid_output_names_are_refused(tmp_path: Path, name: str, untouched: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        check_name(tmp_path / name, tmp_path / untouched)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0.png,nan,80,16", "0.png has x nan, y 80.0, radius 16.0; they must be finite"),
        ("0.png,100,80,7", "radius 7.0; they must be finite, the radius at least 8"),
        ("0.png,100,80,16\n0.png,90,80,16", "has two lines for 0.png; keep one"),
        ("0.jpg,100,80,16", "names 0.jpg, which is not a photograph in"),
    ],
)
def test_invalid_circles_are_refused(folder: Path, line: str, message: str) -> None:
    (folder / "circles.csv").write_text(f"name,x,y,radius\n{line}\n", encoding="utf-8-sig")
    with pytest.raises(InvalidInput, match=message):
        read_photographs(folder, folder.parent / "untouched.png", LARGEST)
    (folder / "circles.csv").unlink()


def test_contact_wider_than_the_ball_is_its_equator_or_refused(folder: Path) -> None:
    (folder / "circles.csv").write_text(f"name,x,y,radius\n0.png,90,80,{1.05 * LARGEST}\n1.png,90,80,{1.3 * LARGEST}\n")
    photographs, _, unusable = read_photographs(folder, folder.parent / "untouched.png", LARGEST)
    (folder / "circles.csv").unlink()
    (equator,) = (one.contact for one in photographs if one.name == "0.png")
    assert equator.radius == LARGEST
    assert ball_impression(TRUE, equator, BALL).max() == pytest.approx(BALL, rel=0.02)
    assert "is wider than the ball, 22.6: correct that line, --ball-radius or --mm-per-pixel" in unusable["1.png"]


def test_printed_dots_are_filled_in(tmp_path: Path) -> None:
    described = HardSet("dots", tail=0.3, shape=(120, 160), mm_per_pixel=0.12, markers=MarkerGrid(rows=6, cols=8, radius=4.5e-4))
    plain, largest = replace(described, markers=None), 2.35 / 0.12
    Image.fromarray(hard_untouched(described)).save(tmp_path / "untouched.png")
    for number in range(4):
        Image.fromarray(hard_press(described, number).image).save(tmp_path / f"{number}.png")
    photographs, untouched, _ = read_photographs(tmp_path, tmp_path / "untouched.png", largest)
    assert np.abs(untouched - hard_untouched(plain).astype(float)).mean() < 3
    for number, one in enumerate(photographs):
        press = hard_press(plain, number)
        assert np.abs(one.image - press.image.astype(float)).mean() < 3
        assert one.contact.radius == pytest.approx(press.circle.radius, rel=0.15)


def test_contact_outside_its_photograph_is_unusable(folder: Path) -> None:
    (folder / "circles.csv").write_text("name,x,y,radius\n0.png,-30,80,16\n1.png,-10,80,16\n")
    photographs, _, unusable = read_photographs(folder, folder.parent / "untouched.png", LARGEST)
    (folder / "circles.csv").unlink()
    assert unusable["0.png"] == ("its contact in circles.csv, x -30, y 80, radius 16, lies outside its 213 x 160 pixels; correct that line")
    assert [photograph_read.contact for photograph_read in photographs if photograph_read.name == "1.png"] == [Circle(-10, 80, 16)]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"--mm-per-pixel": "1e6"}, "the ball's radius is 2e-06 pixels, 8 are needed: are --ball-radius and --mm-per-pixel in mm?"),
        ({"--thickness": "1e5"}, "are lengths in mm?"),
        ({"--mm-per-pixel": "0.08", "--thickness": "0.1"}, "mm deep, the gel is 0.1 mm thick; give its thickness with --thickness"),
    ],
)
def test_lengths_in_another_unit_give_a_clear_error(folder: Path, tmp_path: Path, changed: dict[str, str], message: str) -> None:
    stated = {"--ball-radius": "2", "--mm-per-pixel": "0.03", "--untouched": str(folder.parent / "untouched.png")} | changed
    options = [text for pair in stated.items() for text in pair]
    assert message in vt("calibrate-sensor", folder, tmp_path / "mine.yaml", *options, fails=True)


@pytest.mark.slow
def test_train_gives_a_network_that_reads_the_photographs(folder: Path, tmp_path: Path) -> None:
    """The network finds the contact and its depth in the photographs."""
    out, untouched = tmp_path / "mine.yaml", folder.parent / "untouched.png"
    size = ["--ball-radius", "2", "--mm-per-pixel", str(1e3 * TRUE.pitch[1]), "--untouched", str(untouched)]
    printed = vt("calibrate-sensor", folder, out, *size, "--position-degree", 2, "--train")
    assert "mine-touch: `vt-pipeline read-touch PHOTOGRAPHS" in printed
    photographs, image, _ = read_photographs(folder, untouched, LARGEST)
    reader = TouchReader(out, image)
    for contact_photograph in photographs[:3]:
        reading = reader.read(contact_photograph.image)
        rows, cols = np.nonzero(reading.contact)
        assert (
            np.hypot(cols.mean() - contact_photograph.contact.x, rows.mean() - contact_photograph.contact.y)
            < 0.3 * contact_photograph.contact.radius
        )
        deepest = ball_impression(load_sensor(out), contact_photograph.contact, BALL).max()
        assert reading.indentation.max() == pytest.approx(deepest, rel=0.4)
