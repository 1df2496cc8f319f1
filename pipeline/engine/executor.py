"""Executors process the units of a plan. Their output depends neither on the executor nor on the order."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence

from pipeline.engine.session import Work, session
from pipeline.engine.unit import Unit
from pipeline.store.row_files import Result


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


class Deferred(Executor):
    """Another executor, created on first use: importing its libraries takes a second, and there may be no units."""

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
        """Let the other executor process the units."""
        return self._delegate.run(work, units)

    def close(self, *, at_once: bool) -> None:
        """Release the other executor's resources, if it was created."""
        if self._executor is not None:
            self._executor.close(at_once=at_once)
