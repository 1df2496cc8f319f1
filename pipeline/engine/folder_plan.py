"""The plan of a dataset stage: one folder, filled in a work folder and then published."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from functools import cached_property
from pathlib import Path

from rich.console import Console

from pipeline.console import Meter
from pipeline.engine.plan import Forecast, Plan, Request, Result
from pipeline.engine.process_group import HELP, HelpDone, process_group
from pipeline.engine.stage import DatasetJob, DatasetStage
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.directory import hashes_of
from pipeline.store.mirror import mirrored
from pipeline.store.publish import publish_folder
from pipeline.store.record import FolderRecord, read_record, sealed
from pipeline.store.storage import Place, files_below, names_in, remove

_WORK = re.compile("[0-9a-f]{16}")
"""What a folder is called that is being filled; another one may be part of a longer name, as models/gcn/touch."""


class FolderPlan(Plan[DatasetStage]):
    """A folder that a dataset stage fills."""

    def __init__(self, request: Request[DatasetStage]) -> None:
        super().__init__(request)
        self.name = request.folder or self.stage.writes(self.settings)
        self.splits = self.stage.splits(self.settings)
        self.objects = [item.object_id for item in request.objects if item.split in self.splits]
        if not self.objects:
            raise StoreError(
                f"{self.stage.name}: manifest {request.manifest} has no object in split {' or '.join(self.splits)}; give its `splits` some"
            )
        for collection in self.inputs:
            for object_id in self.objects:
                collection.shard(object_id)  # an error where it has not been made yet
        self.directory.check_origins([*(collection.artifact.name for collection in self.inputs), *self.models])

    @property
    def path(self) -> Place:
        """The folder's name without its version."""
        return self.directory.root / self.name

    @property
    def lock(self) -> Place:
        """Beside the work folders of this folder."""
        return self.directory.work(self.name) / "lock"

    @cached_property
    def input_digests(self) -> dict[str, str]:
        """The digest of the rows that are looked at, by artifact."""
        return {collection.artifact.name: collection.rows_digest(self.splits) for collection in self.inputs}

    @cached_property
    def key(self) -> str:
        """The hash of everything the folder depends on."""
        return digest.of_json({"stage": self.stage_key, "inputs": self.input_digests})

    @property
    def total(self) -> int:
        """The objects of its splits."""
        return len(self.objects)

    def up_to_date(self) -> bool:
        """Whether the folder is there, with every file, made under the same key."""
        try:
            record, folder = self.directory.folder(self.name), self.directory.folder_path(self.name)
        except StoreError:
            return False
        if self.request.check:
            return record.key == self.key and hashes_of(folder) == record.files
        return record.key == self.key and record.files.keys() <= files_below(folder).keys()

    def forecast(self) -> Forecast:
        """What the stage says of itself."""
        cost, done = self.stage.cost(self.settings, self.total), self.up_to_date()
        return Forecast(0 if done else self.total, self.total, cost.seconds, cost.kilobytes, done)

    def make(self, console: Console) -> Result:
        """Fill the folder; killed at any moment and run again, the stage finds what it left in its work folder."""
        began = time.perf_counter()
        with mirrored(self._work) as work:
            filled = work.with_suffix(".json")  # the record, from when the folder is filled until it is published
            record = self._finished(work, filled) or self._fill(work, filled, console)
            publish_folder(self.directory, self.name, work, record)
            filled.unlink()
        for folder in {self._work.parent, work.parent}:  # what is no longer needed, and what runs with other settings left half done
            for name in filter(_WORK.fullmatch, names_in(folder)):
                remove(folder / name)
        return Result(self.total, 0, time.perf_counter() - began)

    def help(self, console: Console) -> None:
        """Train together with the process that fills the folder; nothing is written."""
        with mirrored(self._work, send=False) as work, suppress(HelpDone):
            self.stage.make(self._job(work, console))

    @property
    def _work(self) -> Place:
        return self.directory.work(self.name) / self.key[:16]

    def _job(self, work: Path, console: Console) -> DatasetJob:
        return DatasetJob(self.request.data, work, self.settings, self.request.seed, self.models, console)

    def _fill(self, work: Path, filled: Path, console: Console) -> FolderRecord:
        began = time.perf_counter()
        self._verify_inputs(console)
        if self.stage.trains and (together := process_group()):
            together.broadcast(self.name, HELP)
        facts = self.stage.make(self._job(work, console))
        record = FolderRecord(
            **self.provenance(),
            splits=self.splits,
            inputs=self.input_digests,
            facts=facts,
            seconds=round(time.perf_counter() - began, 2),
            files=hashes_of(work),
        )
        filled.write_bytes(sealed(record))
        return record

    def _verify_inputs(self, console: Console) -> None:
        """Compare every row that is looked at with its digest, so that nothing is learned from what is damaged."""
        with Meter(console, f"{self.stage.name} checks its inputs", self.total * len(self.inputs), "rows") as meter:
            for collection in self.inputs:
                for object_id in self.objects:
                    collection.view(object_id).verify()
                    meter.advance()

    def _finished(self, work: Path, filled: Path) -> FolderRecord | None:
        """The record of a run that was killed after it had filled the folder."""
        try:
            record = read_record(filled, FolderRecord)
        except StoreError:
            return None
        return record if (record.key, record.files) == (self.key, hashes_of(work)) else None
