"""The session in which a process works through the units of a run."""

import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass

from pipeline.config.settings import ObjectSettings, Settings
from pipeline.console import visible
from pipeline.engine import keys
from pipeline.engine.stage import ObjectStage
from pipeline.engine.unit import Unit
from pipeline.engine.versions import processor
from pipeline.errors import InvalidInput, PipelineError, StageError, StoreError
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Failure, processor_kind
from pipeline.store.rows import Result, Row, RowFiles, conform
from pipeline.store.shard import RowView
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

    def rows(self) -> RowFiles:
        """Return the row files that wait to be published."""
        return RowFiles(DataDirectory(self.data).work(self.stage.output.name), self.stage.output)


@contextmanager
def session(work: Work) -> Iterator[Callable[[Unit], Result]]:
    """Open what a stage keeps between objects; yield a function that processes a unit and saves its row or failure.

    A `StageError` says that it cannot be opened, or that its data files are not those of the plan (nothing is wrong
    with any object); a `StoreError`, that an input is damaged.
    """
    directory, rows, kind = DataDirectory(work.data), work.rows(), processor_kind(processor())
    with ExitStack() as stack:
        try:
            collections = [directory.collection(artifact) for artifact in work.stage.inputs(work.settings)]
            for name, expected in work.models.items():
                if directory.folder(name).digest() != expected:
                    raise StoreError(f"{directory.folder_path(name)} was replaced meanwhile; run again")
            models = {name: directory.verified_folder(name) for name in work.models}
            process = stack.enter_context(work.stage.session(work.settings, models))
            check_assets(work.stage, work.settings, work.assets)  # after they were read
        except Exception as error:
            raise _cannot_start(work.stage, error) from error

        def make(unit: Unit) -> Result:
            inputs = verified_inputs(unit, collections)
            began = time.perf_counter()
            row: Row = {}
            failure = None
            try:
                row = conform(work.stage.output, process(unit, inputs))
            except InvalidInput as error:
                failure = Failure(stage=work.stage.name, reason=visible(str(error)))
            except MemoryError:
                failure = Failure(stage=work.stage.name, reason=f"memory ran out; {MORE_MEMORY}")
            except Exception as error:  # a bug in this project: the other objects are processed anyway
                if is_machine_fault(error):
                    raise
                return Result(name=unit.name, key=unit.key, seconds=time.perf_counter() - began, bug=traceback.format_exc())
            seconds = time.perf_counter() - began
            return rows.save(Result(name=unit.name, key=unit.key, seconds=seconds, processor=kind, failure=failure), row, unit.category)

        yield make


def check_assets(stage: ObjectStage, settings: Settings, planned: str) -> None:
    """Raise a `StageError` if a hand, sensor or scene file is no longer the planned one.

    Otherwise keys would name a file that made nothing.
    """
    with suppress(InvalidInput, OSError):  # it was removed, or cannot be used any more
        if keys.assets_digest(stage.assets(settings)) == planned:
            return
    raise StageError(f"a file that {stage.name} reads (of its hand, sensor or scene) changed meanwhile; run again")


def record_crash(work: Work, unit: Unit, reason: str) -> Result:
    """Record the failure of an object that ends the process that works on it."""
    failure = Failure(stage=work.stage.name, reason=reason)
    return work.rows().save(Result(name=unit.name, key=unit.key, failure=failure), {}, unit.category)


def _cannot_start(stage: ObjectStage, error: Exception) -> StageError:
    """Describe why a session cannot be opened: a library is not properly installed, or a description file cannot be used."""
    if isinstance(error, PipelineError):
        return StageError(f"{stage.name} cannot start: {error}")
    where = "`vt-pipeline doctor` names what is missing" if isinstance(error, (ImportError, OSError, RuntimeError)) else "is this a bug?"
    return StageError(f"{stage.name} cannot start: {type(error).__name__}: {error}; {where}")


def verified_inputs(unit: Unit, collections: list[Collection]) -> dict[str, RowView]:
    """Read a unit's rows of the inputs, by artifact; a `StoreError` says that one is damaged, or was replaced since."""
    views: dict[str, RowView] = {}
    for collection in collections:
        name = collection.artifact.name
        view = views[name] = collection.view(unit.name)
        if view.record.digest != unit.inputs[name]:
            raise StoreError(f"{view.shard.path}: {name} of {unit.name} was replaced meanwhile; run again")
        view.verify()
    return views
