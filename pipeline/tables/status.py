"""List the contents of a data directory, for people and for scripts."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from operator import attrgetter
from typing import Any

from rich.console import Console
from rich.markup import escape

from pipeline.cluster.slurm import jobs_account
from pipeline.console import Columns, abbreviate, pluralise, show_tables, tabulate
from pipeline.errors import OtherVersion, StoreError
from pipeline.store.directory import DataDirectory, made_by
from pipeline.store.garbage import all_unreferenced
from pipeline.store.storage import File, Location, files_below, list_folder, on_disk
from pipeline.store.validate import check_origins
from schemas.catalogue import ARTIFACTS

JOB_STATES = ("pending", "running", "done", "failed", "unknown")


@dataclass(frozen=True)
class ArtifactAccount:
    """One artifact of a data directory."""

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
    """One folder that a dataset stage filled: a model, an evaluation."""

    folder: str
    stage: str
    megabytes: float
    seconds: float
    digest: str
    facts: dict[str, Any]  # what the stage recorded, such as epochs, the best loss and hardware
    stale: str | None  # why it is out of date


@dataclass(frozen=True)
class Account:
    """The contents of a data directory."""

    garbage: float  # megabytes of what no record names
    artifacts: list[ArtifactAccount] = field(default_factory=list)
    folders: list[FolderAccount] = field(default_factory=list)
    damaged: list[str] = field(default_factory=list)  # a line per thing that cannot be read
    other_versions: list[str] = field(default_factory=list)  # a line per thing that another version of this project wrote
    jobs: dict[str, dict[str, Any]] = field(default_factory=dict)  # of Slurm, by output: name, number, and by task `states` and `why`

    def to_json(self) -> str:
        """Write the account as JSON, by artifact and folder, with `damaged`, `other_versions` and `slurm` if any."""
        named = {entry.artifact: asdict(entry) for entry in self.artifacts} | {entry.folder: asdict(entry) for entry in self.folders}
        further = {"damaged": self.damaged, "other_versions": self.other_versions, "slurm": self.jobs}
        return json.dumps(named | {name: value for name, value in further.items() if value}, indent=2)

    @contextmanager
    def unless_unreadable(self) -> Iterator[None]:
        """Record a `StoreError`, once: what it names cannot be read."""
        try:
            yield
        except StoreError as error:
            lines = self.other_versions if isinstance(error, OtherVersion) else self.damaged
            if str(error) not in lines:
                lines.append(str(error))


def read_account(data: Location) -> Account:
    """Read every artifact and folder of a data directory, in the pipeline's order, and its jobs on a cluster."""
    directory, folder = DataDirectory(data), on_disk(data)
    account = Account(garbage=sum(_megabytes(files_below(path)) for path in all_unreferenced(directory)))
    with account.unless_unreadable():
        account.jobs.update(jobs_account(data))
    if not (folder.is_dir() if folder else list_folder(data) or account.jobs or account.damaged or account.other_versions):
        raise StoreError(f"{data.resolve()} is not a data directory; make one with `vt-pipeline run`, or name another")
    for name in directory.artifact_names():
        with account.unless_unreadable():
            collection = directory.collection(ARTIFACTS[name])
            unfinished = sum(file.endswith(".row") for file in files_below(directory.work(name) / "rows"))
            if collection.shards or unfinished:
                artifact = ArtifactAccount(
                    artifact=name,
                    shards=len(collection.shards),
                    objects=len(collection),
                    failures={item: failure.model_dump() for item in collection if (failure := collection.failure(item))},
                    missing=list(collection.missing),
                    megabytes=sum(_megabytes(files_below(shard.path)) for shard in collection.shards),
                    seconds=sum(row.seconds for shard in collection.shards for row in shard.record.rows),
                    digest=collection.digest(),
                    unfinished=unfinished,
                    processors=dict(collection.processors()),
                    stale=_stale(directory, name),
                )
                account.artifacts.append(artifact)
    for name in directory.folders():
        with account.unless_unreadable():
            record, files = directory.folder(name), files_below(directory.folder_path(name))
            if missing := sorted(record.files.keys() - files.keys()):
                raise StoreError(f"{directory.folder_record(name)}: {missing[0]} is missing; run {made_by(name, record)} again")
            size, stale = _megabytes(files), _stale(directory, name)
            account.folders.append(FolderAccount(name, record.stage, size, record.seconds, record.digest(), record.facts, stale))
    return account


def _stale(directory: DataDirectory, name: str) -> str | None:
    try:
        check_origins(directory, [name])
    except StoreError as error:
        return str(error)
    return None


def _megabytes(files: Mapping[str, File]) -> float:
    return sum(file.bytes for file in files.values()) / 1e6


def show(account: Account, console: Console) -> None:
    """Print the account as tables, and below them every failure with its reason."""
    size: Columns = {
        "MB": (".1f", attrgetter("megabytes")),
        "core s": (".0f", attrgetter("seconds")),
        "digest": ("", lambda entry: entry.digest[:16]),
    }
    counts: Columns = {name: ("", attrgetter(name)) for name in ("shards", "objects", "unfinished")}
    counts["failed"] = ("", lambda entry: len(entry.failures))
    tables = [tabulate("", "artifact", {entry.artifact: entry for entry in account.artifacts}, counts | size)]
    if folders := {entry.folder: entry for entry in account.folders}:
        facts: Columns = {"stage": ("", attrgetter("stage")), **size, "": ("", lambda entry: "stale" if entry.stale else "")}
        tables.append(tabulate("", "folder", folders, facts))
    show_tables(tables, console)
    stale = [*(entry.stale for entry in account.artifacts), *(entry.stale for entry in account.folders)]
    lines = [("yellow", "stale", why) for why in dict.fromkeys(stale) if why]
    if mixed := ", ".join(entry.artifact for entry in account.artifacts if len(entry.processors) > 1):
        lines.append(("yellow", "mixed", f"{mixed}: computed by several kinds of processors, see `vt-pipeline validate --strict`"))
    lines += [
        ("yellow", "incomplete", f"{entry.artifact}: {pluralise(len(entry.missing))} not made yet ({abbreviate(entry.missing)})")
        for entry in account.artifacts
        if entry.missing
    ]
    lines += [("yellow", "other version", line) for line in account.other_versions]
    lines += [("red", "damaged", line) for line in account.damaged]
    if account.garbage > 1:
        lines.append(("default", "garbage", f"{account.garbage:.0f} MB are named by no record; `vt-pipeline collect-garbage` removes them"))
    failures = {  # failures are passed down: each is shown once
        (name, why["stage"]): why["reason"] for entry in account.artifacts for name, why in entry.failures.items()
    }
    lines += [("yellow", "failed", f"{object_id} in {stage}: {reason}") for (object_id, stage), reason in failures.items()]
    for color, state, text in lines:
        console.print(f"[{color}]{state}[/] {escape(text)}")
    _show_jobs(account.jobs, console)


def _count(state: str, job: Mapping[str, Any]) -> int:
    return list(job["states"].values()).count(state)


def _show_jobs(jobs: Mapping[str, dict[str, Any]], console: Console) -> None:
    """Print a line per Slurm job, and below them every task that failed with its log."""
    if not jobs:
        return
    columns: Columns = {"number": ("", lambda job: job["number"])}
    columns |= {state: ("", partial(_count, state)) for state in JOB_STATES}
    columns[""] = ("", lambda job: ", ".join(sorted({why for task, why in job["why"].items() if job["states"][task] != "failed"} - {""})))
    show_tables([tabulate("Slurm", "job", {job["name"]: job for job in jobs.values()}, columns)], console)
    failed = [(job, task) for job in jobs.values() for task, state in job["states"].items() if state == "failed"]
    for job, task in failed:
        console.print(f"[yellow]failed[/] {escape(job['name'])}, task {task}: {escape(job['why'][task])}")
    if failed:
        console.print("run `vt-pipeline submit` with the same arguments to make the missing rows")
