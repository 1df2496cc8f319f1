"""Reading while computing: the next batch is read in a thread while one is learned from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def read_ahead(read: Callable[[T], R], parts: Iterable[T]) -> Iterator[tuple[T, Callable[[], R]]]:
    """Yield each part with a function that waits for its content, or raises the error of reading it; hold at most two parts."""
    with ThreadPoolExecutor(1, "read") as reader:
        begun = ((part, reader.submit(read, part)) for part in parts)
        here = next(begun, None)
        while here:
            part, coming = here
            here = next(begun, None)
            yield part, coming.result
