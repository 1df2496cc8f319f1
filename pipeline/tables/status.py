"""List the contents of a data directory, for people and for scripts."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape

from pipeline.cluster.slurm import JobState, State, slurm_folder, states_of, submitted_jobs
from pipeline.console import Cell, Row, Table, abbreviate, pluralise, show_tables
from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory, made_by
from pipeline.store.garbage import all_unreferenced
from pipeline.store.origins import check_origins
from pipeline.store.row_files import RowFiles
from pipeline.store.storage import File, Location, files_below, list_folder, on_disk
from schemas.catalogue import ARTIFACTS


@dataclass(frozen=True)
class ArtifactAccount:
    """Describe one artifact of a data directory."""

    artifact: str
    shards: int
    objects: int
    failures: dict[str, dict[str, str]]  # stage and reason by object
    missing: list[str]  # objects that incomplete shards lack
    megabytes: float
    seconds: float
    digest: str
    unfinished: int  # objects whose row waits to be published
    processors: dict[str, int]  # rows by the kind of processor that computed them
    stale: str | None  # why it is out of date


@dataclass(frozen=True)
class FolderAccount:
    """Describe one folder that a dataset stage filled: a model, an evaluation."""

    folder: str
    stage: str
    megabytes: float
    seconds: float
    digest: str
    facts: dict[str, Any]  # what the stage recorded, such as epochs, the best loss and hardware
    stale: str | None  # why it is out of date


@dataclass(frozen=True)
class Account:
    """Describe a data directory."""

    artifacts: list[ArtifactAccount]
    folders: list[FolderAccount]
    garbage: float  # megabytes of what no record names
    damaged: list[str]  # a line per thing that cannot be read
    jobs: list[JobState]  # Slurm's

    def to_json(self) -> str:
        """Write the account as JSON, by artifact and folder, with `damaged` and `slurm` if any."""
        named = {entry.artifact: asdict(entry) for entry in self.artifacts} | {entry.folder: asdict(entry) for entry in self.folders}
        damaged = {"damaged": self.damaged} if self.damaged else {}
        jobs = {
            state.job.output: state.job.model_dump() | {"states": {task.task: task.state for task in state.tasks}} for state in self.jobs
        }
        return json.dumps(named | damaged | ({"slurm": jobs} if jobs else {}), indent=2)


def read_account(data: Location) -> Account:
    """Read every artifact and folder of a data directory, in the pipeline's order."""
    is_folder = (folder := on_disk(data)) and folder.is_dir()
    if not list_folder(data) and not is_folder and not submitted_jobs(slurm_folder(data)):
        raise StoreError(f"{data.resolve()} is not a data directory; make one with `vt-pipeline run`, or name another")
    directory = DataDirectory(data)
    account = Account([], [], garbage=sum(_megabytes(files_below(path)) for path in all_unreferenced(directory)), damaged=[], jobs=[])
    for name in directory.artifact_names():
        with _unless_damaged(account):
            artifact = _artifact(directory, name)
            if artifact.shards or artifact.unfinished:
                account.artifacts.append(artifact)
    for name in directory.folders():
        with _unless_damaged(account):
            account.folders.append(_folder(directory, name))
    with _unless_damaged(account):
        folder = slurm_folder(data)
        account.jobs.extend(states_of(folder, submitted_jobs(folder)))
    return account


@contextmanager
def _unless_damaged(account: Account) -> Iterator[None]:
    """Record a `StoreError` as damage, once."""
    try:
        yield
    except StoreError as error:
        if str(error) not in account.damaged:
            account.damaged.append(str(error))


def _artifact(directory: DataDirectory, name: str) -> ArtifactAccount:
    collection = directory.collection(ARTIFACTS[name])
    return ArtifactAccount(
        artifact=name,
        shards=len(collection.shards),
        objects=len(collection),
        failures={object_id: failure.model_dump() for object_id in collection if (failure := collection.failure(object_id))},
        missing=list(collection.missing),
        megabytes=sum(_megabytes(files_below(shard.path)) for shard in collection.shards),
        seconds=sum(row.seconds for shard in collection.shards for row in shard.record.rows),
        digest=collection.digest(),
        unfinished=RowFiles(directory.work(name)).count(),
        processors=dict(collection.processors()),
        stale=_stale(directory, name),
    )


def _stale(directory: DataDirectory, name: str) -> str | None:
    try:
        check_origins(directory, [name])
    except StoreError as error:
        return str(error)
    return None


def _folder(directory: DataDirectory, name: str) -> FolderAccount:
    record = directory.folder(name)
    files = files_below(directory.folder_path(name))
    if missing := sorted(record.files.keys() - files.keys()):
        raise StoreError(f"{directory.folder_record(name)}: {missing[0]} is missing; run {made_by(name, record)} again")
    return FolderAccount(name, record.stage, _megabytes(files), record.seconds, record.digest(), record.facts, _stale(directory, name))


def _megabytes(files: Mapping[str, File]) -> float:
    return sum(file.bytes for file in files.values()) / 1e6


def show(account: Account, console: Console) -> None:
    """Print the account as tables, and below them every failure with its reason."""
    rows: list[Sequence[Cell]] = []
    failures: dict[tuple[str, str], str] = {}
    for entry in account.artifacts:
        counts = (entry.shards, entry.objects, len(entry.failures), entry.unfinished)
        rows.append([entry.artifact, *counts, entry.megabytes, entry.seconds, entry.digest[:16]])
        failures |= {(object_id, why["stage"]): why["reason"] for object_id, why in entry.failures.items()}  # passed down: shown once
    columns = ["artifact", "shards", "objects", "failed", "unfinished", "MB", "core s", "digest"]
    tables = [Table("", columns, list(map(Row, rows)), ["", "", "", "", "", ".1f", ".0f", ""])]
    if account.folders:
        rows = [
            [entry.folder, entry.stage, entry.megabytes, entry.seconds, entry.digest[:16], "stale" if entry.stale else ""]
            for entry in account.folders
        ]
        tables.append(Table("", ["folder", "stage", "MB", "s", "digest", ""], list(map(Row, rows)), ["", "", ".1f", ".0f", "", ""]))
    show_tables(console, tables)
    reasons = [*(entry.stale for entry in account.artifacts), *(entry.stale for entry in account.folders)]
    lines = [("yellow", "stale", reason) for reason in dict.fromkeys(reasons) if reason]
    if mixed := [entry.artifact for entry in account.artifacts if len(entry.processors) > 1]:
        lines.append(
            ("yellow", "mixed", f"{', '.join(mixed)}: computed by several kinds of processors, see `vt-pipeline validate --strict`")
        )
    for entry in account.artifacts:
        if entry.missing:
            lines.append(
                ("yellow", "incomplete", f"{entry.artifact}: {pluralise(len(entry.missing))} not made yet ({abbreviate(entry.missing)})")
            )
    lines += [("red", "damaged", line) for line in account.damaged]
    if account.garbage > 1:
        lines.append(("default", "garbage", f"{account.garbage:.0f} MB are named by no record; `vt-pipeline collect-garbage` removes them"))
    lines += [("yellow", "failed", f"{object_id} in {stage}: {reason}") for (object_id, stage), reason in failures.items()]
    for color, state, text in lines:
        console.print(f"[{color}]{state}[/] {escape(text)}")
    _show_jobs(account.jobs, console)


def _show_jobs(jobs: Sequence[JobState], console: Console) -> None:
    """Print a line per Slurm job, and below them every task that failed with its log."""
    columns: tuple[State, ...] = ("pending", "running", "done", "failed", "unknown")
    rows = []
    for state in jobs:
        why = sorted({task.why for task in state.tasks if task.state in ("pending", "unknown") and task.why})
        counts = state.counts()
        rows.append(Row([state.job.name, str(state.job.number), *(counts.get(name, 0) for name in columns), ", ".join(why)]))
    if rows:
        show_tables(console, [Table("Slurm", ["job", "number", *columns, ""], rows)])
    failed = [(state.job, task) for state in jobs for task in state.tasks if task.state == "failed"]
    for job, task in failed:
        log = f"; see {task.log}" if task.log.exists() else ""
        console.print(f"[yellow]failed[/] {escape(job.name)}, task {task.task}: {escape(task.why + log)}")
    if failed:
        console.print("run `vt-pipeline submit` with the same arguments to make the missing rows")
