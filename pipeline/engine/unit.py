"""Units of work: objects' rows and folders."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.rng import numpy_rng
from pipeline.store.record import Failure


@dataclass(frozen=True)
class Unit:
    """A unit of work: an object's row, or a folder.

    Attributes
    ----------
    name
        The object's id, or the folder's name.
    key
        The hash of everything that it depends on.
    inputs
        The digests of its inputs, by artifact.
    seed
        The root seed.
    category, split, source
        Of an object, as in the manifest.
    failure
        The reason why it cannot be processed: an input failed, or its file cannot be read.
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
        """Make a random generator for this object and the given names (stage, attempt, …)."""
        return numpy_rng(self.seed, self.name, *identity)
