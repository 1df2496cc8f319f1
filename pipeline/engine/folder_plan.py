"""Folders: a plan with one unit, which a dataset stage fills in a work folder and which is then published."""

import re
import shlex
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.console import Console

from pipeline.console import Meter, pluralise
from pipeline.engine.plan import Made, Plan, Request
from pipeline.engine.stage import DatasetJob, Unit
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.digest import hashes_of, is_hidden
from pipeline.store.directory import DataDirectory, changed_files
from pipeline.store.publish import commit_folder, folder_target
from pipeline.store.record import FolderRecord, read_record, serialise_with_checksum
from pipeline.store.storage import files_below, list_folder, remove
from pipeline.store.temporary import local_copy
from pipeline.store.validate import check_origins

_WORK = re.compile("[0-9a-f]{16}")  # names of work folders; another name may be part of a longer one, such as models/gcn/touch


class FolderPlan(Plan):
    """The plan of a folder that a dataset stage fills."""

    record: FolderRecord | None

    def __init__(self, request: Request[Any]) -> None:
        directory = DataDirectory(request.data)
        self.name = request.folder or request.stage.writes(request.settings)
        self.work = directory.work(self.name)
        super().__init__(request, directory, directory.folder_record(self.name), self.work / "lock", request.objects)

    def refresh(self) -> None:
        self.record = None
        with suppress(StoreError):
            self.record = read_record(self.record_path, FolderRecord)

    def prepare(self) -> "FolderPlan":
        """Plan the folder's unit; refuse inputs that lack an object of the stage's splits, or have it in another split."""
        super().prepare()
        stage, manifest, splits = self.stage, self.request.manifest, self.stage.splits(self.settings)
        self.object_ids = [item.object_id for item in self.objects if item.split in splits]
        if not self.object_ids:
            raise StoreError(f"{stage.name}: manifest {manifest} has no object in split {' or '.join(splits)}; give its `splits` some")
        for collection in self.inputs:
            for object_id in self.object_ids:
                collection.shard(object_id)  # an error where it has not been made yet
        self._refuse_other_splits()
        check_origins(self.directory, stage.reads(self.settings))
        inputs = {collection.artifact.name: collection.rows_digest(splits) for collection in self.inputs}
        self.key = digest.of_json({"stage": self.stage_key, "inputs": inputs})
        self.units = [Unit(self.name, self.key, inputs, self.request.seed)]
        self.total = sum(all(collection.failure(object_id) is None for collection in self.inputs) for object_id in self.object_ids)
        if not self.total:
            raise StoreError(
                f"{stage.name}: all {len(self.object_ids)} objects in split {' or '.join(splits)} failed; see `vt-pipeline status "
                f"{shlex.quote(str(self.directory.root))}`"
            )
        return self

    def _refuse_other_splits(self) -> None:
        """Refuse a manifest whose splits changed since the objects were made: training selects by the stored splits."""
        splits, manifest_splits = self.stage.splits(self.settings), {item.object_id: item.split for item in self.objects}
        for collection in self.inputs:
            for object_id in collection:
                stored, stated = collection.row(object_id).split, manifest_splits.get(object_id)
                if stored != stated and not {stored, stated}.isdisjoint(splits):
                    current = f"in split {stated}" if stated else "not there"
                    raise StoreError(
                        f"{collection.folder} has {object_id} in split {stored}, in manifest {self.request.manifest} it is {current}; run "
                        f"`vt-pipeline run {collection.first.record.stage}` with this manifest first: it keeps what is made"
                    )

    def up_to_date(self) -> bool:
        """Check that the folder is published, complete, and has the current key; with `check`, by reading every file."""
        if self.record is None or self.record.key != self.key:
            return False
        folder, files = self.path.with_name(self.record.location), self.record.files
        return not changed_files(folder, files) if self.request.check else files.keys() <= files_below(folder).keys()

    def current(self) -> Made:
        return self.answer(f"up to date, {pluralise(self.total)}")

    def estimate(self) -> tuple[int, float, float]:
        cost = self.stage.cost(self.settings, self.total)
        return self.total, cost.seconds, cost.kilobytes

    def intent(self, objects: int, cost: str) -> str:
        return f"would be made from {pluralise(objects)}, {cost}"

    def fill(self, console: Console) -> Made:
        """Fill the folder; killed at any moment and run again, the stage finds what it left in its work folder."""
        began = time.perf_counter()
        with local_copy(self.work / self.key[:16], send=True) as work:
            record_path = work.with_suffix(".json")  # the record, from when the folder is filled until it is published
            record = self._finished(work, record_path) or self._run_stage(work, record_path, console)
            for name in filter(is_hidden, files_below(work)):  # a checkpoint, which a killed run no longer needs
                with suppress(OSError):  # a system file in use
                    remove(work / name)
            commit_folder(self.directory, self.name, work, record)
            self.refresh()
            record_path.unlink()
        for folder in {self.work, work.parent}:  # this work, and unfinished work of runs with other settings
            for name in filter(_WORK.fullmatch, list_folder(folder)):
                remove(folder / name)
        seconds = time.perf_counter() - began
        return self.answer(f"made from {pluralise(self.total)} in {seconds:.1f} s", objects=self.total, seconds=seconds)

    def _finished(self, work: Path, record_path: Path) -> FolderRecord | None:
        """Read the record of a run that was killed after it had filled the folder, or had moved it to its place too."""
        with suppress(StoreError):
            record = read_record(record_path, FolderRecord)
            moved = folder_target(self.record_path, record)
            if record.key == self.key and (record.files == hashes_of(work) or not changed_files(moved, record.files)):
                return record
        return None

    def _run_stage(self, work: Path, record_path: Path, console: Console) -> FolderRecord:
        began, (unit,) = time.perf_counter(), self.units
        rows = len(self.object_ids) * len(self.inputs)
        with Meter(console, f"{self.stage.name} checks its inputs", rows, "rows") as meter:  # nothing is learned from damaged data
            for collection in self.inputs:
                for object_id in self.object_ids:
                    collection.view(object_id).verify()
                    meter.advance()
        facts = self.stage.make(DatasetJob(self.request.data, work, self.settings, self.request.seed, self.models, console, unit.name))
        record = FolderRecord(
            **self.provenance(),
            splits=self.stage.splits(self.settings),
            inputs=unit.inputs,
            facts=facts,
            seconds=round(time.perf_counter() - began, 2),
            files=hashes_of(work),
        )
        record_path.write_bytes(serialise_with_checksum(record))
        return record
