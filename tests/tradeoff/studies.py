"""Small made-up studies."""

from __future__ import annotations

from typing import Any

from pipeline.tradeoff.measurements import Measurement, Provenance, Study

MADE = Provenance("make tradeoff", "abc1234", "a machine", "2026-01-31")


def measurement(
    label: str, seconds: float, error: float, *, metric: str = "depth, um", kind: str = "setting", **values: Any
) -> Measurement:
    """Make a measurement of one kilobyte, whose bound is 1.5 times its error."""
    return Measurement(label, kind, values, seconds, 1.0, {metric: error}, 1.5 * error)


def study(stage: str, *measurements: Measurement, objects: int = 4, whole_dataset: bool = False, **more: Any) -> Study:
    """Make a study of four objects, named as its stage."""
    return Study(stage, stage, objects, whole_dataset, ("seconds",), MADE, measurements, **more)
