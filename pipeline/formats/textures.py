"""The textures of mesh files; those that cannot be decoded are listed with the reason."""

import hashlib
from collections.abc import Set
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipeline.errors import InvalidInput, first_line
from pipeline.formats.file_content import foreign_content
from pipeline.formats.mesh_companions import Companions

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "DDS", "PPM", "PCX")
"""Accepted formats of textures. Pillow would read others too, some by starting other programs."""
MAX_PIXELS = 2**26
"""Maximum number of pixels of all textures of a mesh file: one of 8192 × 8192, 256 MiB as RGBA."""


class Textures:
    """The decoded textures of one mesh file, of which several materials may use one; those that are no image join `companions.unread`.

    `transparent` names the textures whose alpha is an opacity; other formats say so per material.
    """

    def __init__(self, companions: Companions, transparent: Set[str] = frozenset()) -> None:
        self.unread = companions.unread
        self._names: dict[str, str] = {}
        self._digests: dict[int, tuple[Image.Image, str]] = {}  # Pillow forgets a file's content when it is decoded
        self._decoded: dict[tuple[str, bool], NDArray[np.uint8] | None] = {}
        self._pixels = 0
        self._transparent: set[str] = set()
        for name in companions.images:
            digest = hashlib.sha256(companions[name]).hexdigest()
            self._names.setdefault(digest, name)
            if name in transparent:
                self._transparent.add(digest)
            self._open(name, companions[name])

    def read(self, name: str, content: bytes, *, opaque: bool = False) -> NDArray[np.uint8] | None:
        """Decode an image from its content; `name` is for messages, the rest as for `decode`."""
        key = (hashlib.sha256(content).hexdigest(), opaque)
        if key not in self._decoded:
            image = self._open(name, content)
            self._decoded[key] = None if image is None else self._decode(image, name, opaque=opaque)
        return self._decoded[key]

    def _open(self, name: str, content: bytes) -> Image.Image | None:
        """Open an image; list it as not read, with the reason, if it is none."""
        try:
            return Image.open(BytesIO(content), formats=FORMATS)
        except UnidentifiedImageError:  # its message has a memory address
            self.unread.append(f"{name} is {foreign_content(content) or 'damaged, or no image that can be read; convert it to PNG'}")
        except Exception as error:  # Pillow's readers raise whatever their parsing trips over
            self.unread.append(f"{name} cannot be decoded: {first_line(error)}")
        return None

    def is_transparent(self, image: Image.Image) -> bool:
        """Check whether the file says of an image that its alpha is an opacity."""
        return self._digest(image) in self._transparent

    def decode(self, image: Image.Image, *, opaque: bool) -> NDArray[np.uint8] | None:
        """Decode an image to (height, width, 4) sRGB and opacity, 255 if `opaque`: the same array for the same content."""
        digest = self._digest(image)
        if (digest, opaque) not in self._decoded:
            self._decoded[digest, opaque] = self._decode(image, self._names.get(digest, "a texture"), opaque=opaque)
        return self._decoded[digest, opaque]

    def _decode(self, image: Image.Image, name: str, *, opaque: bool) -> NDArray[np.uint8] | None:
        if image.format not in (None, "MPO", *FORMATS):  # None: made by a conversion; MPO: opened as JPEG; `_open` has listed others
            return None
        self._pixels += image.width * image.height
        if self._pixels > MAX_PIXELS:
            raise InvalidInput(f"it has {self._pixels} pixels of textures, {MAX_PIXELS} are the most; make them smaller")
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

    def _digest(self, image: Image.Image) -> str:
        if id(image) not in self._digests:
            file = getattr(image, "fp", None)
            digest = hashlib.sha256(file.getbuffer()).hexdigest() if isinstance(file, BytesIO) else str(id(image))
            self._digests[id(image)] = image, digest  # with the image, as another one may have its id later
        return self._digests[id(image)][1]


def _eight_bits(image: Image.Image) -> Image.Image:
    """Scale an image of 16 bits of grey, which Pillow's conversion would cut off at 255; raise a `ValueError` for 32 bits."""
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PPM"):
        return Image.fromarray(np.rint(np.asarray(image) / 257).astype(np.uint8))
    if image.mode in ("I", "F"):
        raise ValueError("it has 32 bits per pixel; save it with 8 per colour")
    return image
