"""Executors make the units of a plan. What they write depends neither on which executor it was, nor on the order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence

from pipeline.engine.session import Work, session
from pipeline.engine.unit import Unit
from pipeline.store.row_files import Result


class Executor(ABC):
    """Makes units somewhere; a context manager that gives back what it has opened."""

    @property
    @abstractmethod
    def processes(self) -> int:
        """How many objects are processed at a time."""

    @abstractmethod
    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Make units, in whatever order they finish.

        Raises
        ------
        StageError
            The stage's session cannot be opened: nothing is wrong with any object.
        StoreError
            An input is damaged.
        """

    def close(self, *, at_once: bool) -> None:  # noqa: B027 some have nothing to give back
        """Give back what was opened; `at_once` does not wait for what is being processed."""

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(at_once=kind is not None)


class Serial(Executor):
    """One unit after the other in this process, which a crash in a native library then ends; no unit is too slow for it."""

    processes = 1

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Make units in their order."""
        with session(work) as process:
            yield from map(process, units)


class Deferred(Executor):
    """Another executor, made on first use: importing its libraries takes a second, and there may be nothing to make."""

    def __init__(self, make: Callable[[], Executor]) -> None:
        self._make = make
        self._executor: Executor | None = None

    @property
    def _delegate(self) -> Executor:
        if self._executor is None:
            self._executor = self._make()
        return self._executor

    @property
    def processes(self) -> int:
        """Those of the other executor."""
        return self._delegate.processes

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Let the other executor make the units."""
        return self._delegate.run(work, units)

    def close(self, *, at_once: bool) -> None:
        """Give back what the other executor has opened, if it was made."""
        if self._executor is not None:
            self._executor.close(at_once=at_once)
