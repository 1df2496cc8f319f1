"""Executors process the units of a plan. Their output depends neither on the executor nor on the order."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from pipeline.engine.session import Work, session
from pipeline.engine.unit import Unit
from pipeline.store.rows import Result


class Executor(ABC):
    """Processes units; a context manager that releases its resources."""

    @property
    @abstractmethod
    def processes(self) -> int:
        """The number of objects processed at a time."""

    @abstractmethod
    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units; yield results in the order in which they finish.

        A `StageError` says that the stage's session cannot be opened (nothing is wrong with any object), a `StoreError`
        that an input is damaged.
        """

    def close(self, *, at_once: bool) -> None:  # noqa: B027 some have nothing to release
        """Release resources; `at_once` does not wait for units in progress."""

    def __enter__(self) -> "Executor":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(at_once=kind is not None)


class Serial(Executor):
    """Processes units one after the other in this process: a crash in a native library ends it, and there is no time limit."""

    processes = 1

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units in their order."""
        with session(work) as process:
            yield from map(process, units)
