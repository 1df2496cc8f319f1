"""Textures of a mesh file: each is decoded once, and all together have a bounded number of pixels."""

from __future__ import annotations

import hashlib
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InvalidInput

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "DDS", "PPM", "PCX", "MPO")
"""Formats that textures have. Pillow would read others too, some with the help of other programs."""

MAX_PIXELS = 2**26
"""Pixels of all textures of a mesh file: one of 8192 × 8192, 256 MiB as RGBA."""


class Textures:
    """The decoded textures of one mesh file, of which several materials may use one."""

    def __init__(self) -> None:
        self._decoded: dict[str, NDArray[np.uint8]] = {}
        self._digests: dict[int, str] = {}  # Pillow forgets a file's content when it is decoded
        self._pixels = 0

    def decode(self, image: Image.Image) -> NDArray[np.uint8]:
        """Decode an image to (height, width, 4) uint8 sRGB and opacity; the same array for the same content.

        Raises
        ------
        InvalidInput
            The textures so far and this one have too many pixels.
        ValueError, OSError
            It is of no format that textures have, or damaged.
        """
        digest = self._digests.setdefault(id(image), _digest(image))
        if digest not in self._decoded:
            if image.format not in (None, *FORMATS):  # None: made by a conversion
                raise ValueError(f"a texture is {image.format}; convert it to PNG or JPEG")
            self._pixels += image.width * image.height
            check_pixels(self._pixels)
            self._decoded[digest] = np.array(image.convert("RGBA"))
        return self._decoded[digest]


def check_pixels(pixels: int) -> None:
    """Refuse more pixels than `MAX_PIXELS`."""
    if pixels > MAX_PIXELS:
        raise InvalidInput(f"its textures have {pixels} pixels in all, {MAX_PIXELS} are the most; make them smaller")


def _digest(image: Image.Image) -> str:
    file = getattr(image, "fp", None)
    return hashlib.sha256(file.getbuffer()).hexdigest() if isinstance(file, BytesIO) else str(id(image))
