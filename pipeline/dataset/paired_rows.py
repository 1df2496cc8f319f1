"""The same arrays of two data directories, object by object."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.dataset.object_rows import ObjectRows

Arrays = list[np.ndarray]


def paired_rows(first: Path, second: Path, *arrays: str) -> Iterator[tuple[str, Arrays, Arrays]]:
    """Read arrays, given by name, of the objects that failed in neither of two data directories.

    Yields
    ------
    An object's id, and its arrays from the first and from the second directory.
    """
    ours, theirs = (ObjectRows(data, arrays, split=None) for data in (first, second))
    for object_id in ours.object_ids:
        if object_id not in theirs.left_out:
            yield object_id, [ours.read(name, object_id) for name in arrays], [theirs.read(name, object_id) for name in arrays]
