"""Folders: a plan with one unit, which a dataset stage fills in a work folder and which is then published."""

import re
import shlex
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.console import Console

from pipeline.console import Meter
from pipeline.engine.plan import Forecast, Plan, Request, Summary
from pipeline.engine.stage import DatasetJob, DatasetStage, names_read
from pipeline.engine.unit import Unit
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.digest import hashes_of, is_hidden
from pipeline.store.directory import DataDirectory, changed_files
from pipeline.store.local_copy import local_copy
from pipeline.store.origins import check_origins
from pipeline.store.publish import FolderOutput
from pipeline.store.record import FolderRecord, read_record, serialise_with_checksum
from pipeline.store.storage import files_below, list_folder, remove

_WORK = re.compile("[0-9a-f]{16}")
"""Names of work folders; another name may be part of a longer one, such as models/gcn/touch."""


def plan_folder(request: Request[Any]) -> Plan[FolderOutput]:
    """Plan a folder that a dataset stage fills.

    A `StoreError` says that no object is in the stage's splits, that all of them failed, or that an input has not been
    made, or not from the current inputs.
    """
    stage: DatasetStage = request.stage
    name, splits = request.folder or stage.writes(request.settings), stage.splits(request.settings)
    directory = DataDirectory(request.data)
    plan = Plan(request, directory, FolderOutput(directory, name))
    objects = _objects(plan)
    if not objects:
        raise StoreError(f"{stage.name}: manifest {request.manifest} has no object in split {' or '.join(splits)}; give its `splits` some")
    for collection in plan.inputs:
        for object_id in objects:
            collection.shard(object_id)  # an error where it has not been made yet
    _refuse_other_splits(plan)
    check_origins(directory, names_read(stage, plan.settings))
    inputs = {collection.artifact.name: collection.rows_digest(splits) for collection in plan.inputs}
    plan.key = digest.of_json({"stage": plan.stage_key, "inputs": inputs})
    plan.units = [Unit(name, plan.key, inputs, request.seed)]
    plan.total = sum(all(collection.failure(name) is None for collection in plan.inputs) for name in objects)
    if not plan.total:
        raise StoreError(
            f"{stage.name}: all {len(objects)} objects in split {' or '.join(splits)} failed; see `vt-pipeline status "
            f"{shlex.quote(str(directory.root))}`"
        )
    return plan


def _objects(plan: Plan[FolderOutput]) -> list[str]:
    splits = plan.stage.splits(plan.settings)
    return [item.object_id for item in plan.request.objects if item.split in splits]


def _refuse_other_splits(plan: Plan[FolderOutput]) -> None:
    """Refuse a manifest whose splits changed since the objects were made: training selects by the stored splits."""
    splits, manifest_splits = plan.stage.splits(plan.settings), {item.object_id: item.split for item in plan.request.objects}
    for collection in plan.inputs:
        for object_id in collection:
            stored, stated = collection.row(object_id).split, manifest_splits.get(object_id)
            if stored != stated and not {stored, stated}.isdisjoint(splits):
                current = f"in split {stated}" if stated else "not there"
                raise StoreError(
                    f"{collection.folder} has {object_id} in split {stored}, in manifest {plan.request.manifest} it is {current}; run "
                    f"`vt-pipeline run {collection.first.record.stage}` with this manifest first: it keeps what is made"
                )


def forecast_folder(plan: Plan[FolderOutput]) -> Forecast:
    """Estimate a run from the stage's own estimate."""
    cost, up_to_date = plan.stage.cost(plan.settings, plan.total), plan.up_to_date()
    return Forecast(0 if up_to_date else plan.total, plan.total, cost.seconds, cost.kilobytes, up_to_date)


def make_folder(plan: Plan[FolderOutput], console: Console) -> Summary:
    """Fill the folder; killed at any moment and run again, the stage finds what it left in its work folder."""
    began, work_folder = time.perf_counter(), plan.output.work / plan.key[:16]
    with local_copy(work_folder, send=True) as work:
        record_path = work.with_suffix(".json")  # the record, from when the folder is filled until it is published
        record = _finished(plan, work, record_path) or _fill(plan, work, record_path, console)
        for name in filter(is_hidden, files_below(work)):  # a checkpoint, which a killed run no longer needs
            with suppress(OSError):  # a system file in use
                remove(work / name)
        plan.output.commit(work, record)
        record_path.unlink()
    for folder in {work_folder.parent, work.parent}:  # this work, and unfinished work of runs with other settings
        for name in filter(_WORK.fullmatch, list_folder(folder)):
            remove(folder / name)
    return Summary(plan.total, time.perf_counter() - began)


def _fill(plan: Plan[FolderOutput], work: Path, record_path: Path, console: Console) -> FolderRecord:
    began, (unit,) = time.perf_counter(), plan.units
    _verify_inputs(plan, console)
    facts = plan.stage.make(DatasetJob(plan.request.data, work, plan.settings, plan.request.seed, plan.models, console, unit.name))
    record = FolderRecord(
        **plan.provenance(),
        splits=plan.stage.splits(plan.settings),
        inputs=unit.inputs,
        facts=facts,
        seconds=round(time.perf_counter() - began, 2),
        files=hashes_of(work),
    )
    record_path.write_bytes(serialise_with_checksum(record))
    return record


def _verify_inputs(plan: Plan[FolderOutput], console: Console) -> None:
    """Compare every row that is read with its digest, so that nothing is learned from damaged data."""
    objects = _objects(plan)
    with Meter(console, f"{plan.stage.name} checks its inputs", len(objects) * len(plan.inputs), "rows") as meter:
        for collection in plan.inputs:
            for object_id in objects:
                collection.view(object_id).verify()
                meter.advance()


def _finished(plan: Plan[FolderOutput], work: Path, record_path: Path) -> FolderRecord | None:
    """Read the record of a run that was killed after it had filled the folder, or had moved it to its place too."""
    try:
        record = read_record(record_path, FolderRecord)
    except StoreError:
        return None
    if record.key != plan.key:
        return None
    return record if record.files == hashes_of(work) or not changed_files(plan.output.target(record), record.files) else None
