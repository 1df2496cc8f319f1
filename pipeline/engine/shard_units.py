"""Which units a shard has, from the current inputs, and the state of each: published, waiting to be, pending or failed."""

from functools import cached_property
from typing import Any

from pipeline.config.manifest import Object
from pipeline.console import abbreviate, pluralise
from pipeline.engine import keys
from pipeline.engine.plan import Plan, Request, description_errors
from pipeline.engine.unit import Unit
from pipeline.errors import InvalidInput
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory, shard_of
from pipeline.store.publish import ShardOutput
from pipeline.store.record import Failure
from pipeline.store.rows import Result, Row, row_digest
from pipeline.store.shard import Shard
from pipeline.store.storage import exists
from pipeline.store.validate import check_origins


class ShardUnits(Plan[ShardOutput]):
    """The plan of a shard of an object stage; with `only`, of this object and those that are already published.

    All plans of a run share a directory: the records of inputs are read once.
    """

    def __init__(self, request: Request[Any], directory: DataDirectory, number: int, shards: int) -> None:
        artifact, self.number = request.stage.output, number
        items = [item for item in request.objects if shard_of(item.object_id, shards) == number]
        super().__init__(request, directory, ShardOutput(directory, artifact, number, shards), items)
        self.schema = (artifact.name, artifact.version)
        # objects of the manifest that the shard will lack: `only` asks for another one, and they have not been made yet
        self.missing: tuple[str, ...] = ()

    def _prepare(self) -> None:
        """Plan a unit per object; an `InvalidInput` says that the shard is of another manifest, with objects that this one lacks."""
        items, self.total = list(self.objects), len(self.objects)
        self._refuse_other_manifest()
        if self.request.only is not None:
            included = {self.request.only, *(self.output.shard.position if self.output.shard else ())}
            self.missing = tuple(item.object_id for item in items if item.object_id not in included)
            items = [item for item in items if item.object_id in included]
        check_origins(self.directory, self.stage.reads(self.settings), {item.object_id for item in items})
        if items:  # a shard without objects reads nothing, whether or not its inputs have been made
            # the rows of a shard come from those of the same number
            roots = {collection.artifact.name: collection.shard(items[0].object_id).attributes for collection in self.inputs}
            with description_errors(self.stage):
                self.settings = self.stage.resolve_settings(self.settings, roots)
                self.stage.check_inputs(self.settings, roots)
        self.units = [self._unit(item) for item in items]
        rows = ((unit.key, unit.split) for unit in self.units)
        labels = self._labels() if items else None
        self.key = keys.shard_key(rows, self.number, self.output.shards, self.request.manifest, self.missing, labels)

    def _refuse_other_manifest(self) -> None:
        """Refuse to overwrite objects that the manifest lacks: it may be forgotten."""
        record, manifest = self.output.record, self.request.manifest
        if record is not None and record.manifest != manifest:
            named = {item.object_id for item in self.request.objects}
            if lost := [row.object_id for row in record.rows if row.object_id not in named]:
                raise InvalidInput(
                    f"{self.path} is of manifest {record.manifest}; {manifest} lacks {pluralise(len(lost))} of it "
                    f"({abbreviate(lost)}); name that --manifest (make: MANIFEST=), or another --data (make: DATA=)"
                )

    def _unit(self, item: Object) -> Unit:
        """Plan an object's row, from its source or from its rows of the inputs."""
        inputs: dict[str, str] = {}
        failure: Failure | None = None
        origin: dict[str, Any] = inputs
        if self.inputs:
            for collection in self.inputs:
                row = collection.row(item.object_id)
                inputs[collection.artifact.name] = row.digest
                failure = failure or row.failure
            if files := [path for path in self.stage.files(item.source) if path.is_file()]:  # the stage reports a missing one
                origin = {**inputs, "files": keys.assets_digest(files)}
        else:
            try:
                origin = {"source": keys.source_key(item.source)}
            except (OSError, InvalidInput) as error:
                origin = {"unreadable": str(error)}
                failure = Failure(stage=self.stage.name, reason=f"its file cannot be read: {error}; fix or remove it")
        key = keys.object_key(self.stage_key, item.object_id, item.category, origin)
        return Unit(item.object_id, key, inputs, self.request.seed, item.category, item.split, item.source, failure)

    # ---- the state of its units

    def requested_units(self) -> list[Unit]:
        """List the units of a run: all of the shard, or with `only` the one."""
        return [unit for unit in self.units if self.request.only in (None, unit.name)]

    def pending_units(self) -> list[Unit]:
        """List the requested units without a row, published or waiting to be, under their key, and those to retry."""
        return [unit for unit in self.requested_units() if self._waiting(unit) is None and self._published(unit) is None]

    def _is_retried(self, name: str, failure: Failure | None) -> bool:
        """Check whether an object failed in this stage and is processed again."""
        return self._failed_here(failure) and self.request.retry and self.request.only in (None, name)

    def _failed_here(self, failure: Failure | None) -> bool:
        return failure is not None and failure.stage == self.stage.name

    def _waiting(self, unit: Unit) -> Result | None:
        """Find the result of a unit that waits to be published; None if there is none yet, or it is a failure to retry."""
        if unit.failure:
            return Result(name=unit.name, key=unit.key, digest=row_digest({}, unit.failure, unit.category), failure=unit.failure)
        result = self.output.rows.find(unit.name, unit.key)
        return None if result is None or self._is_retried(unit.name, result.failure) else result

    def _published(self, unit: Unit) -> Shard | None:
        """Find the shard with the published row of a unit; None if there is none with its key, or it is a failure to retry."""
        elsewhere = self._elsewhere.shard(unit.name) if self._elsewhere and unit.name in self._elsewhere else None
        for shard in (self.output.shard, elsewhere):
            row = shard.row(unit.name) if shard and unit.name in shard.position else None
            if row and row.key == unit.key and not self._is_retried(unit.name, row.failure):
                return shard
        return None

    @cached_property
    def _elsewhere(self) -> Collection | None:
        """The artifact in the data directory whose rows are reused."""
        return DataDirectory(self.request.reuse).collection(self.output.artifact) if self.request.reuse else None

    def up_to_date(self) -> bool:
        """Check that the shard is published, complete, has the current key, and holds no failure to retry."""
        if not self.units:
            return not exists(self.output.record_path)
        record = self.output.record
        if record is None or record.key != self.key or any(self._is_retried(row.object_id, row.failure) for row in record.rows):
            return False
        return self.output.is_sound() if self.request.check else self.output.is_complete()

    def _labels(self) -> Row:
        """Read the labels of dimensions from the inputs' shards of the same number: others may be out of date."""
        labels: Row = {}
        for collection in self.inputs:
            shard = collection.shard(self.units[0].name)
            for name, array in self.output.artifact.arrays.items():
                if array.is_coordinate and shard.has(name):
                    labels[name] = shard.read(name)
        return labels
