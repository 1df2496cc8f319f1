"""The device and the number of threads on which networks run."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from pipeline.errors import StageError


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
