"""Each fault of a folder of renderings is named."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.rendering_folder import read_renderings
from pipeline.kernels.vision.camera import Viewpoint
from tools.synthetic_renderings import write_renderings

IMAGES = np.random.default_rng(0).integers(0, 256, (24, 137, 137, 4), dtype=np.uint8)
VIEWPOINTS = [Viewpoint(15.0 * number, 25.0 + number / 10, 0.0, 0.7) for number in range(24)]


@pytest.fixture
def folder(tmp_path) -> Path:
    write_renderings(tmp_path / "rendering", IMAGES, VIEWPOINTS)
    return tmp_path / "rendering"


def test_written_renderings_are_read_back(folder):
    images, viewpoints = read_renderings(folder)
    assert np.array_equal(images, IMAGES)
    assert viewpoints == VIEWPOINTS
    assert (folder / "renderings.txt").read_text().split()[:2] == ["00.png", "01.png"]


def replace_line(folder: Path, line: str) -> None:
    path = folder / "rendering_metadata.txt"
    path.write_text("\n".join([*path.read_text().splitlines()[:-1], line]))


def save_image(folder: Path, size: int, mode: str) -> None:
    Image.new(mode, (size, size)).save(folder / "07.png")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda folder: (folder / "07.png").unlink(), r"07\.png is missing; a model has .* 24 images, 00\.png to 23\.png"),
        (lambda folder: (folder / "rendering_metadata.txt").unlink(), r"rendering_metadata\.txt is missing"),
        (lambda folder: replace_line(folder, ""), "has 23 lines; there must be 24"),
        (lambda folder: replace_line(folder, "1 2 3 4"), "line 24: '1 2 3 4' is not azimuth, elevation"),
        (lambda folder: replace_line(folder, "1 2 0 x 25"), "line 24: '1 2 0 x 25' is not azimuth, elevation"),
        (lambda folder: replace_line(folder, "1 2 5 0.7 25"), "in-plane rotation of 5; it must be 0"),
        (lambda folder: replace_line(folder, "nan 2 0 0.7 25"), "a value that is not finite"),
        (lambda folder: replace_line(folder, "1 2 0 0 25"), "a distance ratio that is not above 0"),
        (lambda folder: (folder / "rendering_metadata.txt").write_bytes(b"\xff"), "is not text"),
        (lambda folder: save_image(folder, 136, "RGBA"), r"07\.png has 136 x 136 pixels of RGBA; a rendering has 137 x 137 pixels of RGBA"),
        (lambda folder: save_image(folder, 137, "RGB"), "137 x 137 pixels of RGB;"),
        (lambda folder: (folder / "07.png").write_bytes((folder / "07.png").read_bytes()[:500]), r"07\.png cannot be read as an image"),
        (lambda folder: (folder / "07.png").write_text("no image"), r"07\.png is no image that can be read; give a file in PNG"),
        (lambda folder: replace_line(folder, "1 95 0 0.7 25"), "has an elevation of 95 degrees; it must be from -90 to 90"),
    ],
)
def test_fault_of_a_rendering_folder_is_named(folder, spoil, message):
    spoil(folder)
    with pytest.raises(InvalidInput, match=message):
        read_renderings(folder)
