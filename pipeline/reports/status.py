"""What is in a data directory: an account for people, and for scripts."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape

from pipeline.cluster.slurm import JobState, State, slurm_folder, states_of, submitted_jobs
from pipeline.console import counted, few, print_table
from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import everything_unnamed
from pipeline.store.row_files import RowFiles
from pipeline.store.storage import File, Place, files_below, names_in, on_disk
from schemas.catalogue import ARTIFACTS


@dataclass(frozen=True)
class ArtifactAccount:
    """Describe one artifact of a data directory.

    `failures` are the stage and reason by object; `missing` are the objects that incomplete shards lack; `unfinished` counts those whose
    row waits to be published; `processors` the rows by the kind of processor that computed them.
    """

    artifact: str
    shards: int
    objects: int
    failures: dict[str, dict[str, str]]
    missing: list[str]
    megabytes: float
    seconds: float
    digest: str
    unfinished: int
    processors: dict[str, int]


@dataclass(frozen=True)
class FolderAccount:
    """Describe one folder that a dataset stage filled: a model, an evaluation.

    `facts` is what the stage said of it: epochs, the best loss, hardware; `stale` why it is not what would be made now.
    """

    folder: str
    stage: str
    megabytes: float
    seconds: float
    digest: str
    facts: dict[str, Any]
    stale: str | None


@dataclass(frozen=True)
class Account:
    """Describe a data directory.

    `garbage` is what no record names, in megabytes; `damaged` says what could not be read, one line each; `jobs` are those on Slurm.
    """

    artifacts: list[ArtifactAccount]
    folders: list[FolderAccount]
    garbage: float
    damaged: list[str]
    jobs: list[JobState]

    def to_json(self) -> str:
        """Write the account as JSON, by artifact and folder; under `damaged` and `slurm` what is, where anything is."""
        named = {one.artifact: asdict(one) for one in self.artifacts} | {one.folder: asdict(one) for one in self.folders}
        damaged = {"damaged": self.damaged} if self.damaged else {}
        jobs = {state.job.output: state.job.model_dump() | {"states": {one.task: one.state for one in state.tasks}} for state in self.jobs}
        return json.dumps(named | damaged | ({"slurm": jobs} if jobs else {}), indent=2)


def read_account(data: Place) -> Account:
    """Look at every artifact and folder of a data directory, in the pipeline's order.

    Raises
    ------
    StoreError
        There is no data directory.
    """
    if not names_in(data) and not ((folder := on_disk(data)) and folder.is_dir()):
        raise StoreError(f"{data.resolve()} is no data directory; `vt-pipeline run` makes one, --data names it")
    directory = DataDirectory(data)
    account = Account([], [], garbage=sum(_megabytes(files_below(path)) for path in everything_unnamed(directory)), damaged=[], jobs=[])
    for name in ARTIFACTS:
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
    """Note what cannot be read as damaged, once."""
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
        failures={one: failure.model_dump() for one in collection if (failure := collection.failure(one))},
        missing=list(collection.missing),
        megabytes=sum(_megabytes(files_below(shard.path)) for shard in collection.shards),
        seconds=sum(row.seconds for shard in collection.shards for row in shard.record.rows),
        digest=collection.digest(),
        unfinished=RowFiles(directory.work(name)).count(),
        processors=dict(collection.processors()),
    )


def _folder(directory: DataDirectory, name: str) -> FolderAccount:
    record, stale = directory.folder(name), None
    try:
        directory.check_origins([name])
    except StoreError as error:
        stale = str(error)
    there = files_below(directory.folder_path(name))
    if gone := sorted(record.files.keys() - there.keys()):
        raise StoreError(f"{directory.folder_record(name)}: {gone[0]} is missing; run {record.stage} again")
    return FolderAccount(name, record.stage, _megabytes(there), record.seconds, record.digest(), record.facts, stale)


def _megabytes(files: Mapping[str, File]) -> float:
    return sum(file.bytes for file in files.values()) / 1e6


def show(account: Account, console: Console) -> None:
    """Print the account as tables, and below them every failure with its reason."""
    columns = ("artifact", "shards", "objects", "failed", "unfinished", "MB", "core s", "digest")
    rows = []
    failures: dict[tuple[str, str], str] = {}
    for one in account.artifacts:
        counts = (one.shards, one.objects, len(one.failures), one.unfinished)
        rows.append((one.artifact, *counts, f"{one.megabytes:.1f}", f"{one.seconds:.0f}", one.digest[:16]))
        failures |= {(object_id, why["stage"]): why["reason"] for object_id, why in one.failures.items()}  # passed down: shown once
    print_table(console, columns, rows)
    if account.folders:
        folders = [
            (
                escape(one.folder),
                escape(one.stage),
                f"{one.megabytes:.1f}",
                f"{one.seconds:.0f}",
                one.digest[:16],
                "stale" if one.stale else "",
            )
            for one in account.folders
        ]
        print_table(console, ("folder", "stage", "MB", "s", "digest", ""), folders)
    for folder in account.folders:
        if folder.stale:
            console.print(f"[yellow]stale[/] {escape(folder.stale)}")
    if mixed := [one.artifact for one in account.artifacts if len(one.processors) > 1]:
        console.print(f"[yellow]mixed[/] {', '.join(mixed)}: computed by several kinds of processors; see `vt-pipeline validate --strict`")
    for one in account.artifacts:
        if one.missing:
            console.print(f"[yellow]incomplete[/] {one.artifact}: {counted(len(one.missing))} not made yet ({few(one.missing)})")
    for line in account.damaged:
        console.print(f"[red]damaged[/] {escape(line)}")
    if account.garbage > 1:
        console.print(f"{account.garbage:.0f} MB were replaced and are named by no record: `vt-pipeline collect-garbage` removes them")
    for (object_id, stage), reason in failures.items():
        console.print(f"[yellow]failed[/] {escape(object_id)} in {escape(stage)}: {escape(reason)}")
    _show_jobs(account.jobs, console)


def _show_jobs(jobs: Sequence[JobState], console: Console) -> None:
    """Print a line per job, and below them every task that failed with its log."""
    columns: tuple[State, ...] = ("pending", "running", "done", "failed", "unknown")
    rows = []
    for state in jobs:
        why = sorted({task.why for task in state.tasks if task.state in ("pending", "unknown") and task.why})
        counts = state.counts()
        rows.append((escape(state.job.name), state.job.number, *(counts.get(name, 0) for name in columns), escape(", ".join(why))))
    if rows:
        print_table(console, ("job", "number", *columns, ""), rows, "Slurm")
    failed = [(state.job, task) for state in jobs for task in state.tasks if task.state == "failed"]
    for job, task in failed:
        log = f"; see {task.log}" if task.log.exists() else ""
        console.print(f"[yellow]failed[/] {escape(job.name)}, task {task.task}: {escape(task.why + log)}")
    if failed:
        console.print("`vt-pipeline submit` with the same arguments makes what is missing")
