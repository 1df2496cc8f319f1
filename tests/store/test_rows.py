"""Rows are checked against their schema before they are stored."""

import numpy as np
import pytest

from pipeline.errors import StoreError
from pipeline.store.rows import conform
from schemas.base import Array, Artifact

RANGES = Artifact(
    name="ranges",
    version=1,
    summary="Distances.",
    arrays={"depth": Array(("object", "pixel"), "float32", "m", "Distance.", infinite=True)},
)


def test_infinite_arrays_hold_positive_infinity_only():
    (stored,) = conform(RANGES, {"depth": np.array([1, np.inf])}).values()
    assert stored.tolist() == [1, np.inf]
    for value in (-np.inf, np.nan):
        with pytest.raises(StoreError, match="depth holds a value that is not finite"):
            conform(RANGES, {"depth": np.array([1, value])})
