"""Encode arrays as the chunks of a shard's files, and lay chunks out as files of Zarr v3's `sharding_indexed` codec.

The codecs are those that `spec.py` declares: Blosc (zstd of shuffled bytes), crc32c. A chunk is encoded once, by
the process that computed it; publishing concatenates chunks.
"""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import product

import google_crc32c
import numpy as np
from numcodecs import blosc

from pipeline.store.spec import LEVEL, chunking, shuffle_stride
from schemas.base import Array

blosc.use_threads = False  # threads would write a chunk's blocks in the order in which they finish: equal values, other bytes

ABSENT = (2**64 - 1, 2**64 - 1)
"""Offset and size of a missing chunk in the index of a file: Zarr reads the fill value."""


def encode_array(array: Array | None, values: np.ndarray) -> list[bytes]:
    """Encode one object's array as its chunks in C order; strings as JSON, and arrays without a declaration as they are, in one chunk."""
    if values.dtype.kind in "OUT":
        return [with_checksum(json.dumps(values.tolist()).encode())]
    if array is None:
        return [with_checksum(values.tobytes())]
    stored = values[None] if array.per_object else values
    return [encode_chunk(array, stored[block]) for block in _blocks(stored.shape, chunk_shape(array, values.shape))]


def decode_array(array: Array | None, shape: Sequence[int], dtype: str, chunks: Iterable[bytes]) -> np.ndarray:
    """Decode what `encode_array` returned; raise a `ValueError` if a chunk differs from its checksum."""
    if np.dtype(dtype).kind in "OUT":
        return np.array(json.loads(without_checksum(next(iter(chunks)))))
    if array is None:
        return np.frombuffer(without_checksum(next(iter(chunks))), dtype).reshape(shape)
    block_shape = chunk_shape(array, shape)
    values = [np.frombuffer(blosc.decompress(without_checksum(chunk)), dtype).reshape(block_shape) for chunk in chunks]
    decoded = np.empty((1, *shape) if len(block_shape) > len(shape) else tuple(shape), dtype)
    for block, value in zip(_blocks(decoded.shape, block_shape), values, strict=True):
        decoded[block] = value
    return decoded.reshape(shape)


def _blocks(shape: Sequence[int], block_shape: Sequence[int]) -> list[tuple[slice, ...]]:
    """List the parts that an array is cut into, in C order; an empty array has none."""
    if not math.prod(shape):
        return []
    starts = product(*(range(0, size, step) for size, step in zip(shape, block_shape, strict=True)))
    return [tuple(slice(start, start + step) for start, step in zip(corner, block_shape, strict=True)) for corner in starts]


def chunk_shape(array: Array, shape: Sequence[int]) -> tuple[int, ...]:
    """Return the shape of a chunk of one object's array, with the object's axis where the array has one."""
    return chunking(array, (1, *shape))[1] if array.per_object else tuple(shape)


def encode_chunk(array: Array, values: np.ndarray) -> bytes:
    """Encode a chunk, whose axes are those of the stored array."""
    stride = shuffle_stride(array)
    shuffle = blosc.SHUFFLE if stride > 1 else blosc.NOSHUFFLE
    compressed: bytes = blosc.compress(np.ascontiguousarray(values), b"zstd", LEVEL, shuffle, 0, stride)
    return with_checksum(compressed)


def shard_file(chunks: Iterable[bytes | None]) -> Iterator[bytes]:
    """Lay out a file of `sharding_indexed`: the existing chunks, then the index of all, in C order, with its checksum."""
    offset, index = 0, []
    for chunk in chunks:
        index.append(ABSENT if chunk is None else (offset, len(chunk)))
        if chunk is not None:
            offset += len(chunk)
            yield chunk
    yield with_checksum(np.array(index, "<u8").tobytes())


def with_checksum(content: bytes) -> bytes:
    """Append the crc32c of bytes."""
    checksum: int = google_crc32c.value(content)
    return content + checksum.to_bytes(4, "little")


def without_checksum(content: bytes) -> bytes:
    """Remove the crc32c at the end of bytes; raise a `ValueError` if it differs from that of the rest."""
    if len(content) < 4 or google_crc32c.value(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError("its bytes differ from their checksum")
    return content[:-4]
