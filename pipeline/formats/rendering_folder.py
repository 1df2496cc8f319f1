"""Folders of 3D-R2N2's renderings: `SYNSET/MODEL/rendering` with 24 images and their viewpoints."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_text
from pipeline.formats.image_file import open_image
from pipeline.kernels.vision.camera import Viewpoint

VIEWS, PIXELS = 24, 137  # images per model, and pixels per side of each
METADATA = "rendering_metadata.txt"
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
    return [_viewpoint(f"{path}, line {number}: {line.strip()[:80]!r}", line) for number, line in enumerate(lines, start=1)]


def _viewpoint(where: str, line: str) -> Viewpoint:
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
    with open_image(path, ["PNG"], max_bytes=MAX_BYTES) as image:
        if image.size != (PIXELS, PIXELS) or image.mode != "RGBA":
            size = f"{image.width} x {image.height} pixels of {image.mode}"
            raise InvalidInput(f"{path} has {size}; a rendering has {PIXELS} x {PIXELS} pixels of RGBA")
        return np.array(image)
