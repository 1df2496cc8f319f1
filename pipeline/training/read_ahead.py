"""Reading while computing: a thread reads the next batch during the training step of the current one."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def read_ahead(read: Callable[[T], R], parts: Iterable[T]) -> Iterator[tuple[T, Callable[[], R]]]:
    """Yield each part with a function that waits for its content, or raises the error of reading it; hold at most two parts."""
    with ThreadPoolExecutor(1, "read") as reader:
        submitted = ((part, reader.submit(read, part)) for part in parts)
        current = next(submitted, None)
        while current:
            part, future = current
            current = next(submitted, None)
            yield part, future.result
