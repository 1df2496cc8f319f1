"""The device and the number of threads on which networks run."""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from pipeline.errors import StageError

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # glibc's numbers of these parameters
KEPT = 2**28  # bytes of freed memory that a process keeps


def keep_freed_memory() -> None:
    """Let glibc keep what networks free and soon need again: a tenth of an evaluation's time went to mapping and clearing it anew."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt and mallopt(M_MMAP_THRESHOLD, KEPT):  # glibc before 2.35 refuses so much, other libraries have no such function
        mallopt(M_TRIM_THRESHOLD, KEPT)


keep_freed_memory()


def device_of(accelerator: str) -> torch.device:
    """Find the device of a name; `auto` is a GPU if there is one. Raise a `StageError` if it cannot be used."""
    if accelerator == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(accelerator)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise StageError(f"accelerator {accelerator} cannot be used ({error}); take auto or cpu") from error
    return device


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch compute on this many threads of a CPU.

    With one, results do not depend on the machine. With several, each operation waits for its slowest thread: where other processes share
    the cores, that takes ten times as long.
    """
    previous = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(previous)
