"""Image files as arrays."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_file

FORMATS = ("PNG", "JPEG", "BMP", "TIFF")
"""Pillow would open others too, some by starting a program."""
MAX_BYTES, MAX_PIXELS = 2**28, 2**25
"""Of a file, and of the image in it: 33 megapixels take 100 MB."""


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an image file: (rows, cols, 3) uint8 sRGB; grey becomes colour.

    Raises
    ------
    InvalidInput
        The file cannot be read, is of another format than `FORMATS`, is damaged or too large, or has transparency or more than 8 bits
        per colour.
    """
    content = read_file(path, MAX_BYTES)
    try:
        with Image.open(io.BytesIO(content), formats=FORMATS) as image:
            _check(path, image)
            return np.asarray(image.convert("RGB"))
    except InvalidInput:
        raise
    except UnidentifiedImageError as error:
        raise InvalidInput(f"{path} cannot be read as an image; give a file in {', '.join(FORMATS)}") from error
    except Exception as error:  # Pillow's readers raise whatever their parsing trips over
        raise InvalidInput(f"{path} cannot be read as an image ({error}); save it again") from error


def _check(path: Path, image: Image.Image) -> None:
    if image.width * image.height > MAX_PIXELS:
        raise InvalidInput(f"{path} has {image.width} x {image.height} pixels; {MAX_PIXELS} are the most that are read")
    if image.mode not in ("RGB", "L"):
        raise InvalidInput(f"{path} has colours {image.mode}; save it as 8-bit RGB, without transparency")
