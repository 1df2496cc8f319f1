"""The textures of mesh files; those that cannot be decoded are listed with the reason."""

import hashlib
from collections.abc import Mapping
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipeline.errors import InvalidInput, first_line
from pipeline.formats.file_content import foreign_content
from pipeline.formats.mesh_parts import check_count

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "WEBP", "DDS", "PPM", "PCX")
"""Accepted formats of textures. Pillow would read others too, some by starting other programs."""
MAX_PIXELS = 2**26  # maximum number of pixels of all textures of a mesh file: one of 8192 × 8192, 256 MiB as RGBA


class Textures:
    """The decoded textures of one mesh file, of which several materials may use one."""

    def __init__(
        self,
        files: Mapping[str, bytes],  # that the mesh file names
        unread: list[str],  # gets the textures that cannot be decoded, with the reason
    ) -> None:
        self.unread = unread
        self._files = files
        self._decoded: dict[tuple[str, bool], NDArray[np.uint8] | None] = {}
        self._pixels = 0

    def find(self, name: str, *, opaque: bool = False) -> NDArray[np.uint8] | None:
        """Decode the file that the mesh file names so; None for one that is missing, which is listed already."""
        return self.read(name, self._files[name], opaque=opaque) if name in self._files else None

    def read(self, name: str, content: bytes, *, opaque: bool = False) -> NDArray[np.uint8] | None:
        """Decode an image, named so in messages, to (height, width, 4) sRGB and opacity, 255 if `opaque`: once for the same content."""
        key = hashlib.sha256(content).hexdigest(), opaque
        if key not in self._decoded:
            self._decoded[key] = self._decode(name, content, opaque=opaque)
        return self._decoded[key]

    def _decode(self, name: str, content: bytes, *, opaque: bool) -> NDArray[np.uint8] | None:
        try:
            image = Image.open(BytesIO(content), formats=FORMATS)
            self._pixels += image.width * image.height
            check_count("pixels of textures", self._pixels, MAX_PIXELS, "make them smaller")
            pixels = np.array(_eight_bits(image).convert("RGBA"))
        except (InvalidInput, MemoryError):
            raise
        except UnidentifiedImageError:  # its message has a memory address
            self.unread.append(f"{name} is {foreign_content(content) or 'damaged, or no image that can be read; convert it to PNG'}")
            return None
        except Exception as error:  # Pillow's readers raise whatever their parsing trips over
            self.unread.append(f"{name} cannot be decoded: {first_line(error)}")
            return None
        if opaque:
            pixels[..., 3] = 255
        return pixels


def _eight_bits(image: Image.Image) -> Image.Image:
    """Scale an image of 16 bits of grey, which Pillow's conversion would cut off at 255; raise a `ValueError` for 32 bits."""
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PPM"):
        return Image.fromarray(np.rint(np.asarray(image) / 257).astype(np.uint8))
    if image.mode in ("I", "F"):
        raise ValueError("it has 32 bits per pixel; save it with 8 per colour")
    return image
