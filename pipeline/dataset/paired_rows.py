"""The same arrays of two data directories, object by object."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.dataset.object_rows import ObjectRows

Arrays = list[np.ndarray]


def paired_rows(first: Path, second: Path, *arrays: str) -> Iterator[tuple[str, Arrays, Arrays]]:
    """Yield the id of each object that failed in neither of two data directories, and its named arrays from each."""
    ours, theirs = (ObjectRows(data, arrays, split=None) for data in (first, second))
    for object_id in ours.object_ids:
        if object_id not in theirs.left_out:
            yield object_id, [ours.read(name, object_id) for name in arrays], [theirs.read(name, object_id) for name in arrays]
