"""Trade-offs between speed and accuracy, which a stage declares beside its settings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Changes = Mapping[str, Any]
"""Settings of a stage that differ from the user's, by name."""


@dataclass(frozen=True)
class Trade:
    """The settings of a stage that are worth varying, and how their error is measured.

    Attributes
    ----------
    metric, unit
        What the error is, and its unit: "mm", "um" (micrometres), "%" or another.
    candidates
        Settings to measure, beside the user's own and those of the presets. Each takes time: choose few.
    errors
        (data, reference) -> error by object, `unit`: compares the output of a candidate with that of the reference; both are data
        directories, the same one where there is no reference.
    reference
        The finest settings, which the others are compared with; None where the truth is known or nothing is compared.
    trials
        data -> the number of trials per object of which the error is a share; None if it is no share.
    evaluated_by
        A stage to run on the output before errors can be read.
    """

    metric: str
    unit: str
    candidates: tuple[Changes, ...]
    errors: Callable[[Path, Path], Mapping[str, float]]
    reference: Changes | None = None
    trials: Callable[[Path], int] | None = None
    evaluated_by: str | None = None
