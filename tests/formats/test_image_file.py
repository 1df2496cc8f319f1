"""Images that are read, and those that are refused before they are decoded."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image


def encoded(kind: str, mode: str = "RGB") -> bytes:
    file = io.BytesIO()
    Image.new(mode, (3, 2)).save(file, kind)
    return file.getvalue()


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width: int, height: int, *chunks: bytes) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) + b"".join(chunks)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "TIFF"])
@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_the_usual_formats_are_read(tmp_path: Path, kind: str, mode: str) -> None:
    (tmp_path / "image").write_bytes(encoded(kind, mode))
    np.testing.assert_array_equal(read_image(tmp_path / "image"), np.zeros((2, 3, 3), np.uint8))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n", "PNG, JPEG"),
        (encoded("GIF"), "PNG, JPEG"),
        (png(8000, 8000, chunk(b"IDAT", b"")), "8000 x 8000 pixels; 33554432 are the most"),
        (png(20_000, 20_000, chunk(b"IDAT", b"")), "decompression bomb"),
        (png(2**31 - 1, 2**31 - 1, chunk(b"IDAT", b"")), "cannot be read as an image"),
        (encoded("PNG", "RGBA"), "has colours RGBA"),
        (encoded("PNG")[:-30], "cannot be read as an image"),
        (png(2, 2, chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(2**26)))), "cannot be read as an image"),
        (b"", "cannot be read as an image"),
    ],
    ids=["eps", "gif", "pixels", "bomb", "overflow", "alpha", "cut", "text", "empty"],
)
def test_other_formats_and_bombs_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "image").write_bytes(content)
    with pytest.raises(InvalidInput, match=words):
        read_image(tmp_path / "image")
