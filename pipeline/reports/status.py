"""What is in a data directory: an account for people, and for scripts."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pipeline.errors import StoreError
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from pipeline.store.record import Record, folders, standing_record
from schemas.catalogue import ARTIFACTS


@dataclass(frozen=True)
class Account:
    """One artifact of a data directory."""

    artifact: str
    shards: int
    objects: int
    failures: dict[str, dict[str, str]]
    """By object: the stage that failed, and its reason."""
    megabytes: float
    seconds: float
    digest: str
    unfinished: int
    """Objects whose row lies in the work area, waiting for the rest of their shard."""


@dataclass(frozen=True)
class FolderAccount:
    """One folder that a set stage filled: a model, an evaluation."""

    folder: str
    stage: str
    megabytes: float
    seconds: float
    digest: str
    facts: dict[str, Any]
    """What the stage said of it: epochs, the best loss, hardware."""
    stale: str | None
    """Why it is not what would be made now, None where it is."""


def read_folders(data: Path) -> list[FolderAccount]:
    """An account of every finished folder in a data directory."""
    accounts = []
    for name in folders(data):
        record = Record(data / name)
        content = record.content
        try:
            standing_record(Layout(data), name)
            stale = None
        except StoreError as error:
            stale = str(error)
        numbers = (_megabytes(record.folder), content["seconds"], record.digest)
        accounts.append(FolderAccount(name, content["stage"], *numbers, content["facts"], stale))
    return accounts


def read(data: Path) -> list[Account]:
    """An account of every artifact in a data directory, in the pipeline's order.

    Raises
    ------
    StoreError
        There is no data directory, or a shard in it cannot be opened.
    """
    layout = Layout(data)
    if not data.is_dir():
        raise StoreError(f"{data.resolve()} is no data directory; `vt-pipeline run` makes one, --data names it")
    accounts = []
    for artifact in ARTIFACTS.values():
        collection = Collection(layout, artifact)
        unfinished = sum(1 for _ in layout.work(artifact.name).glob("pieces/*/*.npz"))
        if not collection.shards and not unfinished:
            continue
        accounts.append(
            Account(
                artifact=artifact.name,
                shards=len(collection.shards),
                objects=len(collection),
                failures={name: failure for name in collection if (failure := collection.shard(name).failure(name))},
                megabytes=sum(_megabytes(shard.path) for shard in collection.shards),
                seconds=sum(sum(shard.attributes["seconds"]) for shard in collection.shards),
                digest=collection.digest(),
                unfinished=unfinished,
            )
        )
    return accounts


def _megabytes(folder: Path) -> float:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6


def to_json(accounts: list[Account], filled: list[FolderAccount]) -> str:
    """The accounts as JSON, by artifact and folder."""
    named = {account.artifact: asdict(account) for account in accounts} | {account.folder: asdict(account) for account in filled}
    return json.dumps(named, indent=2)


def show(accounts: list[Account], filled: list[FolderAccount], console: Console) -> None:
    """Print the accounts as tables, and below them every failure with its reason."""
    table = Table("artifact", "shards", "objects", "failed", "unfinished", "MB", "core s", "digest", box=None, padding=(0, 2))
    for account in accounts:
        numbers = (account.shards, account.objects, len(account.failures), account.unfinished)
        sizes = (f"{account.megabytes:.1f}", f"{account.seconds:.0f}", account.digest[:16])
        table.add_row(account.artifact, *map(str, numbers), *sizes)
    console.print(table)
    if filled:
        table = Table("folder", "stage", "MB", "s", "digest", "", box=None, padding=(0, 2))
        for folder in filled:
            size = (f"{folder.megabytes:.1f}", f"{folder.seconds:.0f}", folder.digest[:16])
            table.add_row(folder.folder, folder.stage, *size, "" if folder.stale is None else "stale")
        console.print(table)
        for folder in filled:
            if folder.stale:
                console.print(f"[yellow]stale[/] {escape(folder.stale)}")
    shown: set[tuple[str, str]] = set()
    for account in accounts:
        for object_id, failure in account.failures.items():
            if (object_id, failure["stage"]) not in shown:  # a failure passes down to every later artifact
                shown.add((object_id, failure["stage"]))
                console.print(f"[yellow]failed[/] {escape(object_id)} in {failure['stage']}: {escape(failure['reason'])}")
