"""Torch's randomness keyed by identity, as `rng_of` keys numpy's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from pipeline.stage import rng_of


def generator_of(seed: int, *identity: str | int) -> torch.Generator:
    """A torch generator on the CPU, keyed by identity."""
    return torch.Generator().manual_seed(_seed(seed, *identity))


@contextmanager
def seeded_weights(seed: int, name: str) -> Iterator[None]:
    """Initial weights keyed by identity: torch draws them from its global generator, which is put back afterwards."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(_seed(seed, name, "weights"))
        yield


def _seed(seed: int, *identity: str | int) -> int:
    return int(rng_of(seed, *identity).integers(2**63))
