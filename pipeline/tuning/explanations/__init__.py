"""What each stage left out, one module per stage."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module

from pipeline.tuning.explain import Part


def load_explanation(stage: str) -> Callable[..., Iterable[Part]]:
    """What says what a stage models and leaves out: an `ExplainObjects`, or of a set stage an `ExplainSet`."""
    explain: Callable[..., Iterable[Part]] = import_module(f"pipeline.tuning.explanations.{stage.replace('-', '_')}").explain
    return explain
