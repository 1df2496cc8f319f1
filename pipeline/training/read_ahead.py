"""Reading while computing: the next batch is read in a thread while one is learned from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def read_ahead(read: Callable[[T], R], parts: Sequence[T]) -> Iterator[tuple[T, Callable[[], R]]]:
    """Yield each part with what waits for its content, and raises what reading it raised; two parts are held at most."""
    with ThreadPoolExecutor(1, "read") as reader:
        following = reader.submit(read, parts[0]) if parts else None
        for index, part in enumerate(parts):
            coming, following = following, reader.submit(read, parts[index + 1]) if index + 1 < len(parts) else None
            assert coming is not None
            yield part, coming.result
