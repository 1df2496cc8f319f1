"""Units: the things that a run makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.rng import numpy_rng
from pipeline.store.record import Failure


@dataclass(frozen=True)
class Unit:
    """One thing to make: an object's row, or a folder.

    Attributes
    ----------
    name
        The object's id, or the folder's name.
    key
        The hash of everything that it depends on.
    inputs
        The digests of what it is made from, by artifact.
    seed
        The root seed.
    category, split, source
        Of an object: what the manifest says of it.
    failure
        Why there will be no row: an input failed, or its file cannot be read.
    """

    name: str
    key: str = ""
    inputs: dict[str, str] = field(default_factory=dict)
    seed: int = 0
    category: str = ""
    split: str = ""
    source: Mapping[str, Any] = field(default_factory=dict)
    failure: Failure | None = None

    def rng(self, *identity: str | int) -> np.random.Generator:
        """Make a generator for this object and the given names (stage, attempt, …)."""
        return numpy_rng(self.seed, self.name, *identity)
