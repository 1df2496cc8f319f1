"""How much of the extremes is tried: a few examples in `make test`, many in `make test-slow`, the same ones in every run."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import SearchStrategy


def at_size(name: str, few: int, many: int) -> pytest.MarkDecorator:
    """Run a test with `name` = few, and once more, marked slow, with `name` = many."""
    return pytest.mark.parametrize(name, [pytest.param(few, id="few"), pytest.param(many, id="many", marks=pytest.mark.slow)])


def for_all(few: int = 20, many: int = 1000, **strategies: SearchStrategy[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Hypothesis' `given`, with as many examples as the run's size asks for.

    Arguments of the test that have no strategy are pytest's: fixtures and parameters. The examples follow from the test alone
    (`derandomize`), and no clock decides: a busy machine is no failure.
    """

    def decorate(check: Callable[..., None]) -> Callable[..., None]:
        def run(examples: int, **others: Any) -> None:
            limits = settings(max_examples=examples, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
            limits(given(**strategies)(check))(**others)

        asked = inspect.signature(check).parameters.values()
        size = inspect.Parameter("examples", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        run.__signature__ = inspect.Signature([size, *(p for p in asked if p.name not in strategies)])  # type: ignore[attr-defined]
        run.__name__, run.__doc__, run.__module__ = check.__name__, check.__doc__, check.__module__
        run.pytestmark = list(getattr(check, "pytestmark", []))  # type: ignore[attr-defined]
        return at_size("examples", few, many)(run)

    return decorate
