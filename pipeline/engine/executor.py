"""Executors do the jobs of a plan. What they write does not depend on which it was, nor on the order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

from pipeline.engine.jobs import Job, Outcome, Work, session


class Executor(ABC):
    """Does jobs somewhere; a context manager that gives back what it has opened."""

    @property
    @abstractmethod
    def processes(self) -> int:
        """How many objects are processed at a time."""

    @abstractmethod
    def run(self, work: Work, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Do jobs, in whatever order they finish.

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
    """One job after the other in this process, which a crash in a native library then ends, and no job is too slow for."""

    processes = 1

    def run(self, work: Work, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Do jobs in their order."""
        with session(work) as process:
            yield from map(process, jobs)


class Deferred(Executor):
    """Another executor, made when it is first asked for something: its libraries take a second to import, and there may be no jobs."""

    def __init__(self, make: Callable[[], Executor]) -> None:
        self._make = make

    @cached_property
    def _made(self) -> Executor:
        return self._make()

    @property
    def processes(self) -> int:
        """Those of the other executor."""
        return self._made.processes

    def run(self, work: Work, jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Let the other executor do the jobs."""
        return self._made.run(work, jobs)

    def close(self, *, at_once: bool) -> None:
        """Give back what the other executor has opened, if it was made."""
        if "_made" in self.__dict__:
            self._made.close(at_once=at_once)
