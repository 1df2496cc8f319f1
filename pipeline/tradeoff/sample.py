"""Choose a representative sample of a manifest's objects."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from pipeline.config.sources import Object
from pipeline.formats.file_content import regular_stat
from pipeline.rng import numpy_rng

FEWEST, MOST = 4, 32
"""Number of objects in a sample: fewer do not show the spread, more add little information."""


def stratified(objects: Sequence[Object], count: int, seed: int) -> list[Object]:
    """Choose `count` objects, at least one of each split, evenly over splits, categories and sizes of mesh files.

    They are a share of each split, in the manifest's order; all objects if there are no more.
    """
    if len(objects) <= count:
        return list(objects)
    selected: set[str] = set()
    for split in sorted({item.split for item in objects}):
        rng = numpy_rng(seed, "tradeoff-sample", split)
        members = sorted((item for item in objects if item.split == split), key=lambda item: (item.category, _size(item), item.object_id))
        share = max(1, round(count * len(members) / len(objects)))
        ends = np.linspace(0, len(members), share + 1).astype(int)  # one out of each of as many equal parts
        selected |= {members[int(rng.integers(start, stop))].object_id for start, stop in pairwise(ends)}
    return [item for item in objects if item.object_id in selected]


def affordable(objects: Sequence[Object], seed: int, seconds: float, cost: Callable[[Sequence[Object]], float]) -> list[Object]:
    """Choose the largest sample, of `FEWEST` to `MOST` objects, that costs at most these seconds; `FEWEST` if all cost more."""
    for count in range(MOST, FEWEST, -1):
        if cost(sample := stratified(objects, count, seed)) <= seconds:
            return sample
    return stratified(objects, FEWEST, seed)


def _size(item: Object) -> int:
    return regular_stat(item.source["file"]).st_size if "file" in item.source else 0
