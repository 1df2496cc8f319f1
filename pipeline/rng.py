"""Random generators keyed by identity (root seed, stage, object, attempt), never by order, shard or worker."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch


def numpy_rng(seed: int, *identity: str | int) -> np.random.Generator:
    """Make numpy's generator of an identity.

    The names are hashed with separators, hence ("ab", "c") and ("a", "bc") differ.
    """
    digest = hashlib.sha256("\0".join(map(str, (seed, *identity))).encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


def torch_generator(seed: int, *identity: str | int) -> torch.Generator:
    """Make torch's generator of an identity, on the CPU."""
    import torch  # takes a second, which callers without torch save

    return torch.Generator().manual_seed(_torch_seed(seed, *identity))


@contextmanager
def seeded_weights(seed: int, name: str) -> Iterator[None]:
    """Draw initial weights by identity: torch draws them from its global generator, which is restored afterwards."""
    import torch

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(_torch_seed(seed, name, "weights"))
        yield


def _torch_seed(seed: int, *identity: str | int) -> int:
    return int(numpy_rng(seed, *identity).integers(2**63))
