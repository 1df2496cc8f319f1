"""The same work with and without a shortcut, for the benchmark that times both and the tests that hold the results together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Results = Mapping[str, np.ndarray]
EQUAL = "bit for bit"


@dataclass(frozen=True)
class Pair:
    """A shortcut of a stage.

    `with_` and `without` do the same work; `what` says what the first leaves out. Their results, arrays by name, are equal to the bit
    where `bound` is 0, else at most `bound` apart, in `unit`.
    """

    stage: str
    name: str
    what: str
    with_: Callable[[], Results]
    without: Callable[[], Results]
    bound: float = 0.0
    unit: str = ""


def difference(ours: Results, plain: Results) -> float:
    """The greatest difference of any number; 0 where all are equal to the bit, infinite where shapes or infinities differ."""
    worst = 0.0
    for name in ours.keys() | plain.keys():
        a, b = (np.asarray(results[name]) for results in (ours, plain))
        if a.shape != b.shape:
            return np.inf
        if a.tobytes() != b.tobytes():
            with np.errstate(invalid="ignore"):
                apart = np.where(a == b, 0, np.abs(a.astype(np.float64) - b.astype(np.float64)))
            worst = max(worst, float(np.nan_to_num(apart, nan=np.inf, posinf=np.inf).max()), np.finfo(np.float64).tiny)
    return worst
