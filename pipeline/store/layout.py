"""How arrays lie in the files of a shard: the specification that Zarr reads, and encoded chunks."""

import json
import math
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import google_crc32c
import numpy as np
from numcodecs import blosc

from schemas.base import FIXED, INDEXED_DIMS, Array

OBJECTS_PER_FILE = 64  # objects whose chunks share one file: few files, yet no more than these in memory while a shard is written

LEVEL = 5  # zstd's, inside Blosc: 4 ms for a grasp's depth maps and tactile images; 8: an eighth smaller, in six times as long

SMALL_CHUNK = 16 * 1024  # bytes below which splitting further costs more in headers than it saves in reading


def numpy_dtype(array: Array) -> np.dtype[Any]:
    """Return the little-endian numpy dtype of a declared array; object for strings."""
    return np.dtype(object) if array.dtype == "string" else np.dtype(array.dtype).newbyteorder("<")


def array_metadata(array: Array, shape: tuple[int, ...]) -> dict[str, Any]:
    """Describe how an array of this declaration and shape is laid out on disk, as its `zarr.json` does."""
    equation = {"equation": array.equation} if array.equation else {}
    return {
        "shape": [*shape],
        "data_type": array.dtype,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [*chunking(array, shape)[0]]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": "" if array.dtype == "string" else numpy_dtype(array).type().item(),
        "codecs": array_codecs(array, shape),
        "attributes": {"units": array.units, "description": array.description, **equation},
        "dimension_names": [*array.dims],
    }


def array_codecs(array: Array, shape: tuple[int, ...]) -> list[dict[str, Any]]:
    """List the codecs of an array as its `zarr.json` names them.

    zstd over shuffled bytes with a checksum, an object (or one grasp, viewpoint or camera of it) per chunk, up to
    `OBJECTS_PER_FILE` objects per file, so that one of them is read without the others and a dataset is few files.
    """
    little_endian = {"name": "bytes", "configuration": {"endian": "little"}}
    to_bytes = {"name": "bytes"} if numpy_dtype(array).itemsize == 1 else little_endian
    if array.dtype == "string":
        to_bytes = {"name": "vlen-utf8", "configuration": {}}
    stride = shuffle_stride(array)
    shuffle = "shuffle" if stride > 1 else "noshuffle"
    compressor = {"typesize": stride, "cname": "zstd", "clevel": LEVEL, "shuffle": shuffle, "blocksize": 0}
    inner = [to_bytes, {"name": "blosc", "configuration": compressor}, {"name": "crc32c"}]
    if not array.per_object or array.dtype == "string":
        return inner
    sharding = {
        "chunk_shape": [*chunking(array, shape)[1]],
        "codecs": inner,
        "index_codecs": [little_endian, {"name": "crc32c"}],
        "index_location": "end",
    }
    return [{"name": "sharding_indexed", "configuration": sharding}]


def chunking(array: Array, shape: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Compute the shapes of a file and of its chunks for a stored array of this shape."""
    extents = tuple(max(1, size) for size in shape)
    if not array.per_object:
        return extents, extents
    objects = min(OBJECTS_PER_FILE, extents[0])
    file_shape = (objects, *extents[1:])
    single = tuple(1 if dim == "camera" else size for dim, size in zip(array.dims, extents, strict=True))
    item = numpy_dtype(array).itemsize
    if item * math.prod(extents[1:]) <= SMALL_CHUNK:
        return file_shape, file_shape
    if len(array.dims) > 2 and array.dims[1] in INDEXED_DIMS and item * math.prod(single[2:]) > SMALL_CHUNK:
        return file_shape, (1, 1, *single[2:])
    return file_shape, (1, *single[1:])


def shuffle_stride(array: Array) -> int:
    """Return the distance in bytes of the values that Blosc's shuffle gathers: of images a pixel, so that equal colours come together."""
    if array.dtype == "string":
        return 1
    return numpy_dtype(array).itemsize * (FIXED["rgb"] if array.dims[-1] == "rgb" else 1)


def schema_name(path: str) -> str:
    """Return the name of a path in its schema: `meshes/OBJECT_ID/faces` is `meshes/faces`."""
    parts = path.split("/")
    return "/".join((parts[0], parts[-1])) if len(parts) == 3 else path


blosc.use_threads = False  # threads would write a chunk's blocks in the order in which they finish: equal values, other bytes


def encode_array(array: Array | None, values: np.ndarray) -> list[bytes]:
    """Encode one object's array as its chunks in C order; strings as JSON, and arrays without a declaration as they are, in one chunk."""
    if values.dtype.kind in "OUT":
        return [with_checksum(json.dumps(values.tolist()).encode())]
    if array is None:
        return [with_checksum(values.tobytes())]
    stored = values[None] if array.per_object else values
    return [encode_chunk(array, stored[block]) for block in _blocks(array, stored.shape)]


def decode_array(array: Array | None, shape: Sequence[int], dtype: str, chunks: Iterable[bytes]) -> np.ndarray:
    """Decode what `encode_array` returned; raise a `ValueError` if a chunk differs from its checksum."""
    if np.dtype(dtype).kind in "OUT":
        return np.array(json.loads(without_checksum(next(iter(chunks)))))
    if array is None:
        return np.frombuffer(without_checksum(next(iter(chunks))), dtype).reshape(shape)
    decoded = np.empty((1, *shape) if array.per_object else tuple(shape), dtype)
    for block, chunk in zip(_blocks(array, decoded.shape), chunks, strict=True):
        decoded[block] = np.frombuffer(blosc.decompress(without_checksum(chunk)), dtype).reshape(decoded[block].shape)
    return decoded.reshape(shape)


def _blocks(array: Array, shape: Sequence[int]) -> list[tuple[slice, ...]]:
    """List the chunks of one object's array, with the object's axis where it has one, in C order; an empty array has none."""
    if not math.prod(shape):
        return []
    chunk = chunking(array, tuple(shape))[1]
    starts = product(*(range(0, size, step) for size, step in zip(shape, chunk, strict=True)))
    return [tuple(slice(start, start + step) for start, step in zip(corner, chunk, strict=True)) for corner in starts]


def encode_chunk(array: Array, values: np.ndarray) -> bytes:
    """Encode a chunk, whose axes are those of the stored array."""
    stride = shuffle_stride(array)
    shuffle = blosc.SHUFFLE if stride > 1 else blosc.NOSHUFFLE
    compressed: bytes = blosc.compress(np.ascontiguousarray(values), b"zstd", LEVEL, shuffle, 0, stride)
    return with_checksum(compressed)


def with_checksum(content: bytes) -> bytes:
    """Append the crc32c of bytes."""
    checksum: int = google_crc32c.value(content)
    return content + checksum.to_bytes(4, "little")


def without_checksum(content: bytes) -> bytes:
    """Remove the crc32c at the end of bytes; raise a `ValueError` if it differs from that of the rest."""
    if len(content) < 4 or google_crc32c.value(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError("its bytes differ from their checksum")
    return content[:-4]
