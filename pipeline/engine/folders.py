"""Running a set stage: its folder is left alone where it stands under the same key, else filled beside and put in place."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from pipeline.engine import keys
from pipeline.engine.plan import Request
from pipeline.engine.stage import SetJob, SetStage
from pipeline.engine.versions import library_versions
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.atomic import one_writer, put_in_place
from pipeline.store.collection import Collection, check_origins
from pipeline.store.layout import Layout
from pipeline.store.record import RECORD, Record, check_models, hashes_of, rows_digest, standing_record


@dataclass(frozen=True)
class FolderPlan:
    """What a run of a set stage amounts to.

    `inputs` are the digests of the rows that are looked at, by artifact; `records` the folders that are read, by name.
    """

    request: Request[SetStage]
    path: Path
    key: str
    objects: int
    inputs: dict[str, str] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)

    @property
    def work(self) -> Path:
        """Where the folder is filled: a killed run with the same key left its checkpoints there."""
        return Layout(self.request.data).work(self.path.relative_to(self.request.data).as_posix()) / self.key[:16]

    def up_to_date(self) -> bool:
        """Whether the folder stands, made under the same key."""
        try:
            return bool(Record(self.path).content["key"] == self.key)
        except StoreError:
            return False


def plan_folder(request: Request[SetStage], place: str | None = None) -> FolderPlan:
    """Work out a set stage's key; `place` is the folder to fill instead of the stage's own.

    Raises
    ------
    StoreError
        An input or model has not been made for every object of the splits, or from something else than stands there now.
    """
    layout, stage, settings = Layout(request.data), request.stage, request.settings
    splits = stage.splits(settings)
    wanted = [item for item in request.objects if item.split in splits]
    if not wanted:
        raise StoreError(f"{stage.name}: manifest {request.manifest} has no object in split {' or '.join(splits)}; give its `splits` some")
    collections = [Collection(layout, artifact) for artifact in stage.inputs(settings)]
    for collection in collections:
        for item in wanted:
            collection.shard(item.object_id)  # an error where it has not been made yet
        check_models(layout, collection)
    check_origins(collections)
    inputs = {collection.artifact.name: rows_digest(collection, splits) for collection in collections}
    records = {name: standing_record(layout, name) for name in stage.models(settings)}
    key = digest.of_json(
        {
            "stage": stage.name,
            "code": keys.code_hash(stage),
            "settings": settings.results(),
            "seed": request.seed,
            "inputs": inputs,
            "models": {name: record.digest for name, record in records.items()},
        }
    )
    return FolderPlan(request, request.data / (place or stage.folder(settings)), key, len(wanted), inputs, records)


def fill(plan: FolderPlan, console: Console) -> None:
    """Fill the folder, write its record and put it in place.

    Killed at any moment and run again, the stage finds what it left in its work folder.

    Raises
    ------
    StageError
        The stage cannot go on (no device, a loss that is not a number).
    StoreError
        Another run holds the folder.
    """
    request, began = plan.request, time.perf_counter()
    with one_writer(plan.work.with_name("lock"), plan.path):
        if plan.up_to_date():  # by the run that held the lock before
            return
        if _finished(plan):  # by a run that was killed before it put the folder in place
            _place(plan)
            return
        plan.work.mkdir(parents=True, exist_ok=True)
        models = {name: record.folder for name, record in plan.records.items()}
        facts = request.stage.make(SetJob(request.data, plan.work, request.settings, request.seed, models, console))
        content = {
            "stage": request.stage.name,
            "key": plan.key,
            "settings": request.settings.results(),
            "speed_settings": request.settings.speed(),
            "preset": request.preset,
            "seed": request.seed,
            "manifest": request.manifest,
            "splits": list(request.stage.splits(request.settings)),
            "inputs": plan.inputs,
            "models": {name: record.digest for name, record in plan.records.items()},
            "facts": facts,
            "seconds": round(time.perf_counter() - began, 2),
            "versions": library_versions(),
            "files": hashes_of(plan.work),
        }
        (plan.work / RECORD).write_text(json.dumps(content, indent=2, sort_keys=True, allow_nan=False))
        _place(plan)


def _finished(plan: FolderPlan) -> bool:
    record = Record(plan.work)
    return (plan.work / RECORD).exists() and not record.problems() and bool(record.content["key"] == plan.key)


def _place(plan: FolderPlan) -> None:
    put_in_place(plan.work, plan.path)
    for other in plan.work.parent.glob("*/"):  # what runs with other settings left half done
        shutil.rmtree(other, ignore_errors=True)
