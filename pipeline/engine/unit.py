"""Units of work: objects' rows and folders."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.rng import numpy_rng
from pipeline.store.record import Failure, RowRecord
from pipeline.store.rows import Result


@dataclass(frozen=True)
class Unit:
    """A unit of work: an object's row, or a folder."""

    name: str  # the object's id, or the folder's name
    key: str = ""  # hash of everything that it depends on
    inputs: dict[str, str] = field(default_factory=dict)  # digests of its inputs, by artifact
    seed: int = 0  # the root seed
    category: str = ""  # of an object, as in the manifest; so are `split` and `source`
    split: str = ""
    source: Mapping[str, Any] = field(default_factory=dict)
    failure: Failure | None = None  # why it cannot be processed: an input failed, or its file cannot be read

    def rng(self, *identity: str | int) -> np.random.Generator:
        """Make a random generator for this object and the given names (stage, attempt, …)."""
        return numpy_rng(self.seed, self.name, *identity)

    def record(self, result: Result) -> RowRecord:
        """Describe the object's finished row as its shard's record does."""
        return RowRecord(
            object_id=self.name,
            category=self.category,
            split=self.split,
            key=self.key,
            digest=result.digest,
            inputs=self.inputs,
            seconds=round(result.seconds, 4),
            processor=result.processor,
            failure=result.failure,
        )
