"""A shortcut of a stage, to be timed beside the same work without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Results = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Shortcut:
    """A shortcut of a stage, with the same work done without it.

    Attributes
    ----------
    what
        What the shortcut leaves out.
    with_, without
        Do the work, and return arrays by name: equal to the bit where `bound` is 0, else at most `bound` apart, in `unit`.
    """

    stage: str
    name: str
    what: str
    with_: Callable[[], Results]
    without: Callable[[], Results]
    bound: float = 0.0
    unit: str = ""
