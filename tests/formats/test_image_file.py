"""Images are read, or refused before they are decoded."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.image_file import image_files, read_depth, read_image, read_mask


def encoded(kind: str, mode: str = "RGB") -> bytes:
    file = io.BytesIO()
    Image.new(mode, (3, 2)).save(file, kind)
    return file.getvalue()


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width: int, height: int, *chunks: bytes, bits: int = 8) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 2, 0, 0, 0)) + b"".join(chunks)


def tiff_of_16_bits() -> bytes:
    """Write an RGB TIFF file of one pixel."""
    entries = [(256, 1, 1), (257, 1, 1), (258, 3, 98), (259, 1, 1), (262, 1, 2), (273, 1, 104), (277, 1, 3)]
    directory = b"".join(struct.pack("<HHII", tag, 3, count, value) for tag, count, value in entries)
    return struct.pack("<2sHIH", b"II", 42, 8, len(entries)) + directory + bytes(4) + struct.pack("<6H", 16, 16, 16, 9, 9, 9)


def test_images_are_listed_by_name_with_numbers_by_their_value(tmp_path: Path) -> None:
    names = ["1.png", "2.JPG", "10.png", "a2b10.png", "a10b2.png", "a010b3.png", "b.png"]
    files = [tmp_path / name for name in (*reversed(names), "notes.txt", "untouched.png")]
    assert [file.name for file in image_files(files, tmp_path / "untouched.png")] == names


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "TIFF"])
@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_common_formats_are_read(tmp_path: Path, kind: str, mode: str) -> None:
    (tmp_path / "image").write_bytes(encoded(kind, mode))
    np.testing.assert_array_equal(read_image(tmp_path / "image"), np.zeros((2, 3, 3), np.uint8))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n", "PNG, JPEG"),
        (encoded("GIF"), "PNG, JPEG"),
        (png(21, 20, chunk(b"IDAT", b"")), "21 x 20 pixels; 400 are the most"),
        (png(50, 50, chunk(b"IDAT", b"")), "decompression bomb"),
        (encoded("PNG", "RGBA"), "has colours RGBA"),
        (encoded("PNG")[:-30], "no image that can be read"),
        (b"", "is an empty file"),
    ],
    ids=["eps", "gif", "pixels", "many pixels", "alpha", "cut", "empty"],
)
def test_other_formats_and_images_beyond_a_limit_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, words: str
) -> None:
    monkeypatch.setattr("pipeline.formats.image_file.MAX_PIXELS", 400)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    (tmp_path / "image").write_bytes(content)
    with pytest.raises(InvalidInput, match=words):
        read_image(tmp_path / "image")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (png(1, 1, chunk(b"IDAT", zlib.compress(bytes(7))), bits=16), "has colours of 16 bits; save it as 8-bit"),
        (tiff_of_16_bits(), "has colours of 16 bits"),
        (png(1, 1, chunk(b"tRNS", bytes(6)), chunk(b"IDAT", zlib.compress(bytes(4)))), "has colours with a transparent one"),
    ],
    ids=["png", "tiff", "transparent"],
)
def test_colours_that_would_be_cut_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "image").write_bytes(content)
    for read in (read_image, read_mask):
        with pytest.raises(InvalidInput, match=words):
            read(tmp_path / "image")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF"])
def test_photograph_rotated_by_exif_is_read_upright(tmp_path: Path, kind: str) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # turned by 90° clockwise
    photograph = Image.new("RGB", (16, 8))
    photograph.paste((255, 255, 255), (0, 0, 8, 8))  # the left half
    photograph.save(tmp_path / "image", kind, exif=exif)
    levels = read_image(tmp_path / "image")
    assert levels.shape == (16, 8, 3)
    assert (levels[:6] > 200).all(), "what was left is above"
    assert (levels[-6:] < 50).all()
    if kind == "JPEG":
        with pytest.raises(InvalidInput, match="is a JPEG file, in which the outside of a mask is not exactly 0; save it as PNG"):
            read_mask(tmp_path / "image")
    else:
        assert read_mask(tmp_path / "image")[:6].all()


@pytest.mark.parametrize("mode", ["1", "L", "RGB", "P", "P, black last", "I;16"])
def test_mask_is_true_where_pixels_are_not_zero(tmp_path: Path, mode: str) -> None:
    inside = np.array([[True, False, True], [False, False, True]])
    levels = Image.fromarray(np.where(inside, 200, 0).astype(np.uint16 if mode == "I;16" else np.uint8))
    image = levels if mode == "I;16" else levels.convert("L" if mode.startswith("P") else mode)
    if mode.startswith("P"):
        image = Image.fromarray((inside == (mode == "P")).astype(np.uint8))
        image.putpalette([0, 0, 0, 255, 0, 0] if mode == "P" else [255, 0, 0, 0, 0, 0])
    image.save(tmp_path / "mask.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), inside)


def test_depth_images_are_read_unchanged(tmp_path: Path) -> None:
    levels = np.array([[0, 500, 65535]], np.uint16)
    Image.fromarray(levels).save(tmp_path / "depth.png")
    np.save(tmp_path / "levels.npy", np.asfortranarray(levels))
    np.save(tmp_path / "metres.npy", levels.astype(np.float32))
    Image.frombytes("I;16B", (3, 1), levels.astype(">u2").tobytes()).save(tmp_path / "big.tif")
    np.save(tmp_path / "big.npy", levels.astype(">u2"))
    integers = [(name, levels) for name in ("depth.png", "levels.npy", "big.tif", "big.npy")]
    for name, expected in (*integers, ("metres.npy", levels.astype(np.float32))):
        read = read_depth(tmp_path / name)
        np.testing.assert_array_equal(read, expected)
        assert read.dtype == expected.dtype
    Image.new("L", (3, 2)).save(tmp_path / "grey.png")
    with pytest.raises(InvalidInput, match="has depths L; save it as 16-bit grey"):
        read_depth(tmp_path / "grey.png")


def npy(header: str, values: bytes) -> bytes:
    return b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header.encode() + values


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 4)}", bytes(128)), "claims float64 .* has 128 bytes"),
        (npy("{'descr': '|O', 'fortran_order': False, 'shape': (4, 4)}", bytes(128)), "claims object"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-4, -4)}", bytes(128)), "claims float64"),
        (npy("{'descr': '<i8', 'fortran_order': False, 'shape': (4, 4)}", bytes(128)), "holds int64"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (16,)}", bytes(128)), r"holds float64 \(16,\)"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (0, 4)}", b""), r"holds float64 \(0, 4\)"),
        (npy("x" * 100, bytes(128)), "cannot be read as an array"),
        (b"", "is an empty file"),
    ],
    ids=["shape", "objects", "negative", "integers", "row", "nothing", "header", "empty"],
)
def test_array_headers_are_checked_before_memory_is_allocated(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "depth.npy").write_bytes(content)
    with pytest.raises(InvalidInput, match=words):
        read_depth(tmp_path / "depth.npy")
