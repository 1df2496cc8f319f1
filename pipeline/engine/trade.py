"""Trade-offs between speed and accuracy, which a stage declares beside its settings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Changes = Mapping[str, Any]
"""Settings of a stage that differ from the user's, by name."""


@dataclass(frozen=True)
class Trade:
    """The settings of a stage that are worth varying, and how their error is measured."""

    metric: str  # what the error is
    unit: str  # its unit: "mm", "um" (micrometres), "%" or another
    # measured beside the user's own settings and those of the presets; each takes time: choose few
    candidates: tuple[Changes, ...]
    # (data, reference) -> error by object, `unit`: compares the output of a candidate with that of the reference; both are
    # data directories, the same one where there is no reference
    errors: Callable[[Path, Path], Mapping[str, float]]
    # the finest settings, which others are compared with; None where the truth is known or nothing is compared
    reference: Changes | None = None
    # data -> number of trials per object of which the error is a share; None if it is no share
    trials: Callable[[Path], int] | None = None
    evaluated_by: str | None = None  # a stage to run on the output before errors can be read
