"""The textures of mesh files; those that cannot be decoded are listed with the reason."""

import hashlib
from collections.abc import Set
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipeline.errors import first_line
from pipeline.formats.file_content import foreign_content
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import check_count

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "DDS", "PPM", "PCX")
"""Accepted formats of textures. Pillow would read others too, some by starting other programs."""
MAX_PIXELS = 2**26  # maximum number of pixels of all textures of a mesh file: one of 8192 × 8192, 256 MiB as RGBA


class Textures:
    """The decoded textures of one mesh file, of which several materials may use one; those that are no image join `companions.unread`.

    `transparent` names the textures whose alpha is an opacity; other formats say so per material.
    """

    def __init__(self, companions: Companions, transparent: Set[str] = frozenset()) -> None:
        self.unread = companions.unread
        self._names: dict[str, str] = {}
        self._decoded: dict[tuple[str, bool], NDArray[np.uint8] | None] = {}
        self._pixels = 0
        self._transparent: set[str] = set()
        for name in companions.images:
            digest = _digest(companions[name])
            self._names.setdefault(digest, name)
            if name in transparent:
                self._transparent.add(digest)
            self._open(name, companions[name])

    def read(self, name: str, content: bytes, *, opaque: bool = False) -> NDArray[np.uint8] | None:
        """Decode an image, named so in messages, to (height, width, 4) sRGB and opacity, 255 if `opaque`: once for the same content."""
        key = _digest(content), opaque
        if key not in self._decoded:
            image = self._open(name, content)
            self._decoded[key] = None if image is None else self._decode(image, name, opaque=opaque)
        return self._decoded[key]

    def decode(self, image: Image.Image, *, opaque: bool) -> NDArray[np.uint8] | None:
        """Decode an image that Pillow has opened, as `read` does."""
        if (content := _content(image)) is None:  # made by a conversion
            return self._decode(image, "a texture", opaque=opaque)
        return self.read(self._names.get(_digest(content), "a texture"), content, opaque=opaque)

    def is_transparent(self, image: Image.Image) -> bool:
        """Check whether the file says of an image that its alpha is an opacity."""
        content = _content(image)
        return content is not None and _digest(content) in self._transparent

    def _open(self, name: str, content: bytes) -> Image.Image | None:
        try:
            return Image.open(BytesIO(content), formats=FORMATS)
        except UnidentifiedImageError:  # its message has a memory address
            self.unread.append(f"{name} is {foreign_content(content) or 'damaged, or no image that can be read; convert it to PNG'}")
        except Exception as error:  # Pillow's readers raise whatever their parsing trips over
            self.unread.append(f"{name} cannot be decoded: {first_line(error)}")
        return None

    def _decode(self, image: Image.Image, name: str, *, opaque: bool) -> NDArray[np.uint8] | None:
        self._pixels += image.width * image.height
        check_count("pixels of textures", self._pixels, MAX_PIXELS, "make them smaller")
        try:
            pixels = np.array(_eight_bits(image).convert("RGBA"))
        except MemoryError:
            raise
        except Exception as error:  # as above
            self.unread.append(f"{name} cannot be decoded: {first_line(error)}")
            return None
        if opaque:
            pixels[..., 3] = 255
        return pixels


def _content(image: Image.Image) -> bytes | None:
    file = getattr(image, "fp", None)
    return file.getvalue() if isinstance(file, BytesIO) else None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _eight_bits(image: Image.Image) -> Image.Image:
    """Scale an image of 16 bits of grey, which Pillow's conversion would cut off at 255; raise a `ValueError` for 32 bits."""
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PPM"):
        return Image.fromarray(np.rint(np.asarray(image) / 257).astype(np.uint8))
    if image.mode in ("I", "F"):
        raise ValueError("it has 32 bits per pixel; save it with 8 per colour")
    return image
