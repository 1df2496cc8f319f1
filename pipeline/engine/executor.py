"""Executors process the units of a run in sessions of its stage. Their output depends neither on the executor nor on the order."""

import pickle
import signal
import time
import traceback
import uuid
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass

from pipeline.config.settings import ObjectSettings, Settings
from pipeline.console import visible
from pipeline.engine import keys
from pipeline.engine.stage import ObjectStage, Unit
from pipeline.errors import InvalidInput, PipelineError, StageError, StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Failure, processor, processor_kind
from pipeline.store.rows import Result, Row, conform
from pipeline.store.storage import Location, is_machine_fault

MORE_MEMORY = "with more memory, or the mesh made smaller, run again with --retry"


@dataclass(frozen=True)
class Work:
    """What the processes of a run share."""

    stage: ObjectStage
    settings: ObjectSettings
    data: Location
    models: Mapping[str, str]  # digests by name
    assets: str  # digest of the data files when the run was planned

    def save(self, result: Result, row: Row, unit: Unit) -> Result:
        """Keep a unit's row or failure until it is published."""
        return DataDirectory(self.data).rows(self.stage.output).save(result, row, unit.category)


class Executor(AbstractContextManager["Executor"]):
    """Processes units; its resources are released at the end of the context, without waiting for units in progress after an error."""

    @property
    @abstractmethod
    def processes(self) -> int:
        """The number of objects processed at a time."""

    @abstractmethod
    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units; yield results in the order in which they finish."""

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        pass


class Serial(Executor):
    """Processes units one after the other in this process: a crash in a native library ends it, and there is no time limit."""

    processes = 1

    def run(self, work: Work, units: Sequence[Unit]) -> Iterator[Result]:
        """Process units in their order."""
        with session(work) as process:
            yield from map(process, units)


@contextmanager
def session(work: Work) -> Iterator[Callable[[Unit], Result]]:
    """Open what a stage keeps between objects; yield a function that processes a unit and saves its row or failure."""
    directory, stage, kind = DataDirectory(work.data), work.stage, processor_kind(processor())
    with ExitStack() as stack:
        try:
            collections = [directory.collection(artifact) for artifact in stage.inputs(work.settings)]
            for name, expected in work.models.items():
                if directory.folder(name).digest() != expected:
                    raise StoreError(f"{directory.folder_path(name)} was replaced meanwhile; run again")
            models = {name: directory.verified_folder(name) for name in work.models}
            process = stack.enter_context(stage.session(work.settings, models))
            check_assets(stage, work.settings, work.assets)  # after they were read
        except PipelineError as error:
            raise StageError(f"{stage.name} cannot start: {error}") from error
        except Exception as error:  # a library is not properly installed, or a description file cannot be used
            installed = not isinstance(error, (ImportError, OSError, RuntimeError))
            remedy = "is this a bug?" if installed else "`vt-pipeline doctor` names what is missing"
            raise StageError(f"{stage.name} cannot start: {type(error).__name__}: {error}; {remedy}") from error

        def make(unit: Unit) -> Result:
            inputs = {}
            for collection in collections:
                name = collection.artifact.name
                view = inputs[name] = collection.view(unit.name)
                if view.record.digest != unit.inputs[name]:
                    raise StoreError(f"{view.shard.path}: {name} of {unit.name} was replaced meanwhile; run again")
                view.verify()
            began = time.perf_counter()
            row: Row = {}
            failure = None
            try:
                row = conform(stage.output, process(unit, inputs))
            except InvalidInput as error:
                failure = Failure(stage=stage.name, reason=visible(str(error)))
            except MemoryError:
                failure = Failure(stage=stage.name, reason=f"memory ran out; {MORE_MEMORY}")
            except StoreError:  # an input is damaged
                raise
            except Exception as error:  # a bug in this project: the other objects are processed anyway
                if is_machine_fault(error):
                    raise
                return Result(name=unit.name, key=unit.key, seconds=time.perf_counter() - began, bug=traceback.format_exc())
            seconds = time.perf_counter() - began
            return work.save(Result(name=unit.name, key=unit.key, seconds=seconds, processor=kind, failure=failure), row, unit)

        yield make


def check_assets(stage: ObjectStage, settings: Settings, planned: str) -> None:
    """Raise a `StageError` if a hand, sensor or scene file is no longer the planned one: keys would name a file that made nothing."""
    with suppress(InvalidInput, OSError):  # it was removed, or cannot be used any more
        if keys.assets_digest(stage.assets(settings)) == planned:
            return
    raise StageError(f"a file that {stage.name} reads (of its hand, sensor or scene) changed meanwhile; run again")


# ---- in worker processes: one session at a time

_opened: tuple[bytes, AbstractContextManager[object], Callable[[Unit], Result]] | None = None
"""The pickled work whose session is open in this process; the session; and its function that processes a unit."""


def pack(work: Work) -> bytes:
    """Pickle the work of a run, with a number: each run opens its own sessions, for those of the previous run hold its inputs."""
    return pickle.dumps((uuid.uuid4(), keys.code_hash(work.stage), work))


def process_unit(packed: bytes, unit: Unit | None, seconds: float) -> Result | None:
    """Process a unit in the session of a run's packed work, which is opened first if need be; without a unit, only open it.

    The kernel ends this process, even in native code, when the unit takes `seconds`.
    """
    global _opened
    if _opened is None or _opened[0] != packed:
        close_session()
        work: Work
        _, code, work = pickle.loads(packed)
        if keys.code_hash(work.stage) != code:
            raise StageError(f"{work.stage.name}: a worker has other code than this process; install the same version for both")
        context = session(work)
        _opened = (packed, context, context.__enter__())
    if unit is None:
        return None
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return _opened[2](unit)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def close_session() -> None:
    """Close the open session, in the thread that opened it, as OpenGL demands."""
    global _opened
    if _opened is not None:
        context, _opened = _opened[1], None
        context.__exit__(None, None, None)


def opening_error(stage: str) -> StageError:
    """Describe a session whose process dies each time while it opens."""
    return StageError(f"{stage} cannot start: its process died each time (killed, or out of memory?); run again, with fewer --workers")


def record_crash(work: Work, unit: Unit, *, timed_out: bool) -> Result:
    """Record the failure of an object that ends each process that works on it."""
    reason = f"its process died each time (a crash in a native library, or memory ran out); {MORE_MEMORY}"
    if timed_out:
        limit = work.settings.object_seconds
        reason = f"it took longer than object_seconds = {limit}; simplify the mesh, or raise it and run again with --retry"
    failure = Failure(stage=work.stage.name, reason=reason)
    return work.save(Result(name=unit.name, key=unit.key, failure=failure), {}, unit)
