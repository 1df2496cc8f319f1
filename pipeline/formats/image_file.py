"""Image files as arrays and back: photographs, masks, depth images; and arrays that numpy saved."""

import io
import math
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError
from PIL.TiffImagePlugin import BITSPERSAMPLE, TiffImageFile

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import foreign_content, read_file
from pipeline.kernels.arrays import Mask

FORMATS = ("PNG", "JPEG", "BMP", "TIFF")  # Pillow would open others too, some by starting a program
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")  # suffixes of their files
MAX_BYTES, MAX_PIXELS = 2**28, 2**26  # limits of a file, and of the image in it: 67 megapixels take 200 MB
NUMBER = re.compile(r"(\d+)")
GEL_STEP = 1e-7  # m per level of the PNG files of `read-touch`: 16 bits reach 6.5 mm


def image_files(files: Iterable[Path], leave_out: Path) -> list[Path]:
    """Select the files with the suffix of an image, except `leave_out`, sorted by name, numbers in it by their value: 2 before 10."""
    chosen = (file for file in files if file.suffix.lower() in SUFFIXES and file.resolve() != leave_out.resolve())
    return sorted(chosen, key=lambda file: ([int(part) if part.isdecimal() else part for part in NUMBER.split(str(file))], file))


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an image file: (rows, cols, 3) uint8 sRGB; grey becomes colour, and an orientation in its EXIF data is applied."""
    remedy = "8-bit RGB, without transparency"
    pixels: NDArray[np.uint8] = _read_pixels(path, ("RGB", "L"), "colours", remedy, lambda image: np.asarray(image.convert("RGB")))
    return pixels


def read_mask(path: Path) -> Mask:
    """Read a mask: (rows, cols) bool, true where the file is not 0 in some colour; errors as `read_image`, and JPEG is refused."""

    def levels(image: Image.Image) -> NDArray[Any]:
        if image.format == "JPEG":
            raise InvalidInput(f"{path} is a JPEG file, in which the outside of a mask is not exactly 0; save it as PNG")
        return np.asarray(image.convert("RGB") if image.mode == "P" else image)  # P: indices of a palette, in which any colour may be black

    values = _read_pixels(path, ("1", "L", "P", "I;16", "RGB"), "colours", "8-bit grey PNG, 0 outside", levels)
    return np.asarray(values.any(axis=2) if values.ndim == 3 else values != 0)


def read_gel_depth(path: Path) -> NDArray[np.float64]:
    """Read how deep a gel is pressed in, (rows, cols) m: a PNG file of `read-touch`, or a .npy file in m; errors as `read_depth`."""
    depth = read_depth(path)
    return depth.astype(np.float64) * (GEL_STEP if depth.dtype == np.uint16 else 1.0)


def read_depth(path: Path) -> NDArray[Any]:
    """Read a depth image, a 16-bit PNG or TIFF file or a .npy file: (rows, cols) uint16 or floats; errors as `read_image`."""
    is_array = path.suffix.lower() == ".npy"
    numbers = read_array(path) if is_array else _read_pixels(path, ("I;16", "I;16B"), "depths", "16-bit grey", np.asarray)
    numbers = numbers.astype(numbers.dtype.newbyteorder("="), copy=False)  # I;16B, and arrays of other machines, are big-endian
    if numbers.ndim != 2 or not numbers.size or not (numbers.dtype == np.uint16 or numbers.dtype.kind == "f"):
        raise InvalidInput(f"{path} holds {numbers.dtype} {numbers.shape}; a depth image has rows and columns of uint16 or float32")
    return np.asarray(numbers)


@contextmanager
def open_image(path: Path, formats: list[str] | tuple[str, ...] = FORMATS, *, max_bytes: int = MAX_BYTES) -> Iterator[Image.Image]:
    """Open an image file; whatever Pillow trips over becomes an `InvalidInput` that names the file."""
    content = read_file(path, max_bytes)
    try:
        with Image.open(io.BytesIO(content), formats=formats) as image:
            yield image
    except InvalidInput:
        raise
    except UnidentifiedImageError as error:  # its message has a memory address
        problem = foreign_content(content) or f"no image that can be read; give a file in {', '.join(formats)}"
        raise InvalidInput(f"{path} is {problem}") from error
    except Exception as error:  # Pillow's readers raise whatever their parsing trips over
        raise InvalidInput(f"{path} cannot be read as an image ({error}); save it again") from error


def encode_image(pixels: NDArray[Any], file_format: str = "PNG", **options: Any) -> bytes:
    """Write an image as a file's bytes; `options` are Pillow's."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, file_format, **options)
    return buffer.getvalue()


def _read_pixels(path: Path, modes: tuple[str, ...], what: str, remedy: str, convert: Callable[[Image.Image], Any]) -> Any:
    with open_image(path) as image:
        if image.width * image.height > MAX_PIXELS:
            raise InvalidInput(f"{path} has {image.width} x {image.height} pixels; {MAX_PIXELS} are the most; make it smaller")
        bits = 16 if image.format == "PNG" and any(tile[3] == "RGB;16B" for tile in image.tile) else 8  # type: ignore[attr-defined]
        if isinstance(image, TiffImageFile):
            bits = int(max(image.tag_v2.get(BITSPERSAMPLE, (8,))))
        fault = ""
        if image.mode not in modes:
            fault = image.mode
        elif image.mode == "RGB" and bits > 8:  # Pillow would keep their high bytes
            fault = f"of {bits} bits"
        elif image.mode in ("RGB", "L") and "transparency" in image.info:
            fault = "with a transparent one"
        if fault:
            raise InvalidInput(f"{path} has {what} {fault}; save it as {remedy}")
        ImageOps.exif_transpose(image, in_place=True)
        return convert(image)


def read_array(path: Path) -> NDArray[Any]:
    """Read a .npy file; compare its header with its size before allocating memory."""
    file = io.BytesIO(read_file(path, MAX_BYTES))
    try:
        if (version := np.lib.format.read_magic(file)) != (1, 0):
            raise ValueError(f"it is of numpy's format {version}")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
        values = file.read()
        if dtype.hasobject or min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(values):
            raise ValueError(f"it claims {dtype} {shape}, and has {len(values)} bytes of values")
        return np.frombuffer(values, dtype).reshape(shape, order="F" if fortran else "C")
    except Exception as error:  # numpy's parsing of headers raises whatever it trips over
        foreign = foreign_content(file.getvalue())
        problem = f"is {foreign}" if foreign else f"cannot be read as an array ({error}); save it with numpy.save"
        raise InvalidInput(f"{path} {problem}") from error
