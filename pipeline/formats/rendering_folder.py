"""Folders of 3D-R2N2's renderings: `SYNSET/MODEL/rendering` with 24 images and their viewpoints."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import foreign_content, read_file, read_text
from pipeline.kernels.vision.camera import Viewpoint

VIEWS, PIXELS = 24, 137  # images per model, and pixels per side of each
METADATA, LIST = "rendering_metadata.txt", "renderings.txt"
FIELD_OF_VIEW = 25.0
"""Degrees, the last value of each line of the metadata: the cited renderings state it, and were not made with it."""
MAX_BYTES = 2**20  # maximum size of an image, or of the metadata: those of the cited renderings have 5 to 30 kB


def rendering_files(folder: Path) -> list[Path]:
    """List the files that `read_renderings` reads, the metadata first, whether they are there or not."""
    return [folder / METADATA, *(folder / image_name(number) for number in range(VIEWS))]


def image_name(number: int) -> str:
    """Name the image of a viewpoint, from 0."""
    return f"{number:02d}.png"


def read_renderings(folder: Path) -> tuple[NDArray[np.uint8], list[Viewpoint]]:
    """Read the (24, 137, 137, 4) sRGB and opacity of a model from `ShapeNetRendering/SYNSET/MODEL/rendering`, and 24 viewpoints."""
    metadata, *images = rendering_files(folder)
    for path in (metadata, *images):
        if not path.is_file():
            raise InvalidInput(f"{path} is missing; a model has {METADATA} and {VIEWS} images, {images[0].name} to {images[-1].name}")
    viewpoints = _read_metadata(metadata)
    return np.stack([_read_image(path) for path in images]), viewpoints


def _read_metadata(path: Path) -> list[Viewpoint]:
    lines = [line for line in read_text(path, MAX_BYTES).split("\n") if line.strip()]
    if len(lines) != VIEWS:
        raise InvalidInput(f"{path} has {len(lines)} lines; there must be {VIEWS}, one per image")
    return [_viewpoint(path, number, line) for number, line in enumerate(lines, start=1)]


def _viewpoint(path: Path, number: int, line: str) -> Viewpoint:
    where = f"{path}, line {number}: {line.strip()[:80]!r}"
    try:
        *where_from, _ = map(float, line.split())
        viewpoint = Viewpoint(*where_from)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{where} is not azimuth, elevation, in-plane rotation, distance ratio and field of view") from error
    if not all(map(math.isfinite, vars(viewpoint).values())) or viewpoint.distance <= 0:
        raise InvalidInput(f"{where} has a value that is not finite, or a distance ratio that is not above 0")
    if abs(viewpoint.elevation) > 90:
        raise InvalidInput(f"{where} has an elevation of {viewpoint.elevation:g} degrees; it must be from -90 to 90")
    if viewpoint.in_plane != 0:
        raise InvalidInput(f"{where} has an in-plane rotation of {viewpoint.in_plane:g}; it must be 0, as in all the cited renderings")
    return viewpoint


def _read_image(path: Path) -> NDArray[np.uint8]:
    content = read_file(path, MAX_BYTES)
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            if image.size != (PIXELS, PIXELS) or image.mode != "RGBA":
                size = f"{image.width} x {image.height} pixels of {image.mode}"
                raise InvalidInput(f"{path} has {size}; a rendering has {PIXELS} x {PIXELS} pixels of RGBA")
            return np.array(image)
    except InvalidInput:
        raise
    except UnidentifiedImageError as error:  # its message has a memory address, which differs in each run
        problem = foreign_content(content) or "no PNG file; download the model's renderings again"
        raise InvalidInput(f"{path} is {problem}") from error
    except Exception as error:  # Pillow's readers raise whatever their parsing trips over
        raise InvalidInput(f"{path} cannot be read as PNG ({error}); download the model's renderings again") from error


def write_renderings(folder: Path, images: NDArray[np.uint8], viewpoints: Sequence[Viewpoint]) -> None:
    """Write a model's renderings (24, 137, 137, 4), sRGB and opacity, in the form that `read_renderings` reads."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images):
        Image.fromarray(image).save(folder / image_name(number))
    (folder / LIST).write_text("".join(f"{image_name(number)}\n" for number in range(len(images))))
    (folder / METADATA).write_text(
        "".join(" ".join(map(repr, [*vars(viewpoint).values(), FIELD_OF_VIEW])) + "\n" for viewpoint in viewpoints)
    )
