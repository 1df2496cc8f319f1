"""Shards: a plan with a unit per object; an executor makes the missing rows, then all are published as one group."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from typing import Any, cast

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.config.settings import ObjectSettings
from pipeline.console import Meter, abbreviate, pluralise
from pipeline.engine import keys
from pipeline.engine.plan import Made, Plan, Request, description_errors
from pipeline.engine.session import Work, check_assets
from pipeline.engine.unit import Unit
from pipeline.errors import BugFound, InvalidInput, StageError, StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory, shard_of
from pipeline.store.publish import ShardOutput
from pipeline.store.record import Failure, ShardRecord
from pipeline.store.rows import Result, Row, conform, row_digest
from pipeline.store.shard import Shard
from pipeline.store.storage import exists
from pipeline.store.validate import check_origins

NO_OBJECT_LEFT = "all its objects have left the manifest"
HELD_BACK = "not published, because other rows are damaged, have left the manifest, or were made with other settings, inputs or code"


class ShardPlan(Plan[ShardOutput]):
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
                failure = Failure(stage=self.stage.name, reason=f"its file cannot be read: {error}; mend or remove it")
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

    # ---- what a run would do

    def current(self) -> Made:
        """Count the objects of the shard, and name those that failed."""
        rows = {row.object_id: row.failure for row in self.output.record.rows} if self.output.record else {}
        return self._answer(f"up to date, {pluralise(len(self.units))}", rows)

    def _answer(self, text: str, failures: Mapping[str, Failure | None], end: str = "", **facts: Any) -> Made:
        """Say what was made, and which of the requested objects failed."""
        requested = [unit.name for unit in self.requested_units()]
        failed = {name: failure for name in requested if (failure := failures.get(name)) is not None}
        here = {name: failure for name, failure in failed.items() if self._failed_here(failure)}
        before = len(failed) - len(here)
        text += f", {len(here)} failed" if here else ""
        text += f"; {pluralise(before)} failed in an earlier stage" if before else ""
        return self.answer(text + end, failures=here, **facts)

    def _existing(self) -> Collection:
        """Open all shards of the artifact; none if one is damaged or of another version, and must be made again."""
        try:
            return self.directory.collection(self.output.artifact)
        except StoreError:
            return Collection(self.path.parent, self.output.artifact, [])

    def estimate(self) -> tuple[int, float, float]:
        """Estimate a run from the seconds that objects took before, else from the stage's own estimate."""
        cost, pending = self.stage.cost(self.settings), len(self.pending_units())
        same = [shard.record for shard in self._existing().shards if shard.record.settings == self.settings.results()]
        seconds = [row.seconds for record in same for row in record.rows]
        mean = sum(seconds) / len(seconds) if seconds else cost.seconds
        return pending, pending * mean / self.request.executor.processes, self.total * cost.kilobytes

    def intent(self, objects: int, cost: str) -> str:
        """Say how many rows would be made, or that finished ones would be published."""
        if not self.total:
            return f"would be removed, {NO_OBJECT_LEFT}"
        if not objects:
            return f"would {'verify' if self.request.check else 'publish'} {pluralise(self.total, 'finished row')}, {cost}"
        uncounted = "; damaged rows are not counted" if self.request.check and objects < self.total else ""
        return f"would make {objects} of {pluralise(self.total)}, {cost}{uncounted}"

    def remarks(self) -> Iterator[str]:
        """Report published rows whose objects have left the manifest or change their split, and what does not fit the stage."""
        splits = {unit.name: unit.split for unit in self.units}
        rows = self.output.record.rows if self.output.record and self.request.only is None and self.units else ()
        gone = [row.object_id for row in rows if row.object_id not in splits]
        moved = sum(row.split != splits.get(row.object_id, row.split) for row in rows)
        lines = [f"{pluralise(len(gone))} no longer in the manifest ({abbreviate(gone)}), whose rows are dropped"] if gone else []
        lines += [f"{pluralise(moved)} in another split than before"] if moved else []
        if lines:
            yield f"{self.stage.name} {self.path}: {'; '.join(lines)}"
        units = [unit for unit in self.requested_units() if not unit.failure]
        objects = ((unit.name, {inputs.artifact.name: inputs.view(unit.name) for inputs in self.inputs}) for unit in units)
        yield from self.stage.describe_misfits(self.settings, objects) if units else ()

    # ---- processing and publishing

    def fill(self, console: Console) -> Made:
        """Process pending units, then publish.

        With `only`, nothing is published if readers would lose a row that must be made again first, or that cannot be read.
        A shard without objects is withdrawn.
        """
        self.directory.set_shard_count(self.output.shards)
        self._refuse_other_objects()
        if not self.units:
            self.output.withdraw()
            return self.answer(f"removed, {NO_OBJECT_LEFT}")
        results: dict[str, Result] = {}
        for unit in self.units:
            if result := self._reuse(unit):
                self._check_strictness(result)
                results[unit.name] = result
        pending = [unit for unit in self.requested_units() if unit.name not in results]
        began, made = time.perf_counter(), 0
        for result in self._process(pending, console):
            results[result.name] = result
            made += result.failure is None
        seconds = time.perf_counter() - began
        end, notes = "", ()
        if self.request.only is not None and self._loses_rows(results):
            end = (
                f"; {HELD_BACK}: run without --object, or, to look at {self.request.only} alone, run each stage from the first with "
                "another --data"
            )
        else:
            self._publish([results[unit.name] for unit in self.units])
            end = f"; {pluralise(len(self.missing))} of {self.total} not made yet" if self.missing else ""
            notes = tuple(self.stage.describe_shard(self.settings, self.output.shard)) if self.output.shard else ()
        failures = {name: result.failure for name, result in results.items()}
        return self._answer(f"made {pluralise(made)} in {seconds:.1f} s", failures, end, objects=made, seconds=seconds, notes=notes)

    def _loses_rows(self, results: Mapping[str, Result]) -> bool:
        """Check whether readers would lose a published row if these results were published."""
        if self.output.shard is None:
            return exists(self.output.record_path)
        return not self.output.shard.position.keys() <= results.keys()

    def _refuse_other_objects(self) -> None:
        """Refuse to overwrite other objects: two folders of meshes may have one name."""
        existing = self._existing()
        if len(existing) and not any(item.object_id in existing for item in self.request.objects):
            raise StoreError(
                f"{self.path.parent} holds other objects ({abbreviate(list(existing))}), and none of manifest "
                f"{self.request.manifest}; name another --data (make: DATA=), or delete it"
            )

    def _reuse(self, unit: Unit) -> Result | None:
        """Find a row to reuse: one that waits, or the published one, unless it is damaged."""
        result, shard = self._waiting(unit), self._published(unit)
        if result or shard is None:
            return result
        with suppress(StoreError):
            row = shard.row(unit.name)
            processor = shard.record.processor_of(row)
            reused = Result(name=unit.name, key=unit.key, seconds=row.seconds, processor=processor, failure=row.failure)
            return self.output.rows.save(reused, shard.view(unit.name).verify(), unit.category)
        return None

    def _process(self, units: list[Unit], console: Console) -> Iterator[Result]:
        """Process units; raise a bug in one of them, or the change of a file, at the end, when the others are done."""
        work = Work(self.stage, cast(ObjectSettings, self.settings), self.request.data, self.model_digests, self.assets)
        bugs, changed, planned = [], [], {unit.name: unit for unit in units}
        with Meter(console, self.stage.name, len(units), "objects") as meter:
            for result in self.request.executor.run(work, units) if units else ():
                meter.advance()
                if result.bug:
                    bugs.append(result)
                elif self._source_changed(planned[result.name]):
                    self.output.rows.discard(result.name, result.key)
                    changed.append(result.name)
                else:
                    self._check_strictness(result)
                yield result
        if bugs:
            raise BugFound(
                f"{self.stage.name}: processing {', '.join(result.name for result in bugs)} met a bug in vt-pipeline, not a fault "
                f"of the objects. Please report it with this traceback; to continue, leave the objects out of the manifest.\n{bugs[0].bug}"
            )
        if changed:
            raise StageError(f"{self.stage.name}: files of {abbreviate(changed)} changed meanwhile; run again: what is finished is kept")

    def _source_changed(self, unit: Unit) -> bool:
        """Check whether a file of an object is no longer the one in its key: its row may be of either."""
        return self._unit(Object(unit.name, unit.category, dict(unit.source), unit.split)).key != unit.key

    def _check_strictness(self, result: Result) -> None:
        if self.request.strict and result.failure and self._failed_here(result.failure) and self.request.only in (None, result.name):
            raise InvalidInput(f"{result.name}: {result.failure.reason} (--strict: stopped at the first failure)")

    def _publish(self, results: list[Result]) -> None:
        stage, output = self.stage, self.output
        rows = tuple(unit.record(result) for unit, result in zip(self.units, results, strict=True))
        attributes = {
            "schema": output.artifact.name,
            "schema_version": output.artifact.version,
            "stage": stage.name,
            "settings": self.settings.results(),
            "seed": self.request.seed,
            "manifest": self.request.manifest,
            "failures": {row.object_id: row.failure.model_dump() for row in rows if row.failure},
            **stage.attributes(self.settings),
        }
        constants = conform(output.artifact, self._labels() | stage.constants(self.settings), constants=True)
        check_assets(stage, self.settings, self.assets)  # attributes and constants were read just now
        record = ShardRecord(
            **self.provenance(),
            schema_version=output.artifact.version,
            rows=rows,
            missing=self.missing,
            constants_digest=digest.of_arrays(constants),
            metadata={},
        )
        output.commit(record, results, constants, attributes)

    def _labels(self) -> Row:
        """Read the labels of dimensions from the inputs' shards of the same number: others may be out of date."""
        labels: Row = {}
        for collection in self.inputs:
            shard = collection.shard(self.units[0].name)
            for name, array in self.output.artifact.arrays.items():
                if array.is_coordinate and shard.has(name):
                    labels[name] = shard.read(name)
        return labels
