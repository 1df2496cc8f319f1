"""Jobs: an object to process each, and the session in which a process does them."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from pipeline.config.manifest import Object
from pipeline.config.settings import ObjectSettings
from pipeline.engine.stage import ObjectStage, Task
from pipeline.engine.versions import processor
from pipeline.errors import InvalidInput, PipelineError, StageError, StoreError
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory, folder_digest
from pipeline.store.pieces import Pieces
from pipeline.store.record import Failure, processor_kind
from pipeline.store.rows import Row, conform
from pipeline.store.storage import Place, is_machine_fault

MORE_MEMORY = "with more memory, or the mesh made smaller, run again with --retry"


@dataclass(frozen=True)
class Job:
    """An object to process, the key its row is made under, and the digests of the rows it is made from, by artifact."""

    item: Object
    key: str
    inputs: dict[str, str]


@dataclass(frozen=True)
class Work:
    """What every process that does jobs of a run is told; `models` are digests by name."""

    stage: ObjectStage
    settings: ObjectSettings
    seed: int
    data: Place
    models: Mapping[str, str]


@dataclass(frozen=True)
class Outcome:
    """What became of a job: its row, or why there is none, lies among the pieces; unless there was a `bug`, told by its traceback."""

    object_id: str
    seconds: float
    failure: Failure | None = None
    bug: str | None = None


@contextmanager
def session(work: Work) -> Iterator[Callable[[Job], Outcome]]:
    """Open what a stage keeps between objects; yields what processes a job and saves its row, or why there is none.

    Raises
    ------
    StageError
        It cannot be opened: nothing is wrong with any object.
    StoreError
        An input is damaged.
    """
    directory, pieces, kind = DataDirectory(work.data), _pieces(work), processor_kind(processor())
    with ExitStack() as stack:
        try:
            inputs = {artifact.name: directory.collection(artifact) for artifact in work.stage.inputs(work.settings)}
            for name, wanted in work.models.items():
                if folder_digest(directory.folder(name)) != wanted:
                    raise StoreError(f"{directory.folder_path(name)} was replaced meanwhile; run again")
            models = {name: directory.whole_folder(name) for name in work.models}
            process = stack.enter_context(work.stage.session(work.settings, models))
        except Exception as error:
            raise _cannot_start(work.stage, error) from error

        def do(job: Job) -> Outcome:
            task = make_task(job, work.seed, inputs)
            began = time.perf_counter()
            row: Row = {}
            failure = None
            try:
                row = conform(work.stage.output, process(task))
            except InvalidInput as error:
                failure = Failure(stage=work.stage.name, reason=str(error))
            except MemoryError:
                failure = Failure(stage=work.stage.name, reason=f"memory ran out; {MORE_MEMORY}")
            except Exception as error:  # a fault of ours: the other objects are processed all the same
                if is_machine_fault(error):
                    raise
                return Outcome(job.item.object_id, time.perf_counter() - began, bug=traceback.format_exc())
            seconds = time.perf_counter() - began
            pieces.save(job.item.object_id, job.key, job.item.category, row, seconds=seconds, failure=failure, processor=kind)
            return Outcome(job.item.object_id, seconds, failure)

        yield do


def give_up(work: Work, job: Job, reason: str) -> Outcome:
    """Record that an object has no row because of what it does to the process that works on it."""
    failure = Failure(stage=work.stage.name, reason=reason)
    _pieces(work).save(job.item.object_id, job.key, job.item.category, {}, seconds=0.0, failure=failure)
    return Outcome(job.item.object_id, 0.0, failure)


def _pieces(work: Work) -> Pieces:
    return Pieces(DataDirectory(work.data).work(work.stage.output.name))


def _cannot_start(stage: ObjectStage, error: Exception) -> StageError:
    """What a stage's libraries raise where they are not installed as they should be, or a description file that cannot be used."""
    if isinstance(error, PipelineError):
        return StageError(f"{stage.name} cannot start: {error}")
    where = (
        "`vt-pipeline doctor` looks for what is missing" if isinstance(error, (ImportError, OSError, RuntimeError)) else "is this a bug?"
    )
    return StageError(f"{stage.name} cannot start: {type(error).__name__}: {error}; {where}")


def make_task(job: Job, seed: int, collections: Mapping[str, Collection]) -> Task:
    """Make the task of a job, whose inputs are verified to be what the plan was made with.

    Raises
    ------
    StoreError
        An input is damaged, or was replaced since.
    """
    item = job.item
    views = {name: collection.view(item.object_id) for name, collection in collections.items()}
    for name, view in views.items():
        if collections[name].row(item.object_id).digest != job.inputs[name]:
            raise StoreError(f"{view.shard.path}: {name} of {item.object_id} was replaced meanwhile; run again")
        view.verify()
    return Task(
        object_id=item.object_id,
        category=item.category,
        seed=seed,
        source=item.source,
        inputs=views,
        attributes={name: view.shard.attributes for name, view in views.items()},
    )
