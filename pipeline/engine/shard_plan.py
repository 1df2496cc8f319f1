"""Shards: the units that a shard consists of, what a run of an object stage would make of them, and makes."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, cast

from rich.console import Console

from pipeline.config.settings import ObjectSettings
from pipeline.config.sources import Object
from pipeline.console import Meter, abbreviate, pluralise
from pipeline.engine import keys
from pipeline.engine.executor import Work, check_assets
from pipeline.engine.plan import Made, Plan, Request, description_errors
from pipeline.engine.stage import Unit
from pipeline.errors import BugFound, InvalidInput, StageError, StoreError
from pipeline.store import digest
from pipeline.store.directory import Collection, DataDirectory, shard_of
from pipeline.store.publish import commit_shard, withdraw
from pipeline.store.record import Failure, ShardRecord, read_record
from pipeline.store.rows import Result, Row, conform, row_digest
from pipeline.store.shard import RowView, Shard
from pipeline.store.storage import exists, remove
from pipeline.store.validate import check_origins, problems_of

NO_OBJECT_LEFT = "all its objects have left the manifest"
HELD_BACK = "not published, because other rows are damaged, have left the manifest, or were made with other settings, inputs or code"


class ShardPlan(Plan):
    """The plan of a shard of an object stage: an executor makes the missing rows, then all are published as one group.

    With `only`, it is a plan of this object and those that are already published. All plans of a run share a directory:
    the records of inputs are read once.
    """

    record: ShardRecord | None

    def __init__(self, request: Request[Any], directory: DataDirectory, number: int, shards: int) -> None:
        artifact = self.artifact = request.stage.output
        self.number, self.shards, self.schema = number, shards, (artifact.name, artifact.version)
        self.rows = directory.rows(artifact)  # that wait to be published
        self.requested: list[Unit] = []  # the units of a run: all of the shard, or with `only` the one
        # objects of the manifest that the shard will lack: `only` asks for another one, and they have not been made yet
        self.missing: tuple[str, ...] = ()
        self.elsewhere = DataDirectory(request.reuse) if request.reuse else None
        record_path = directory.shard_record(artifact.name, number, shards)
        items = [item for item in request.objects if shard_of(item.object_id, shards) == number]
        super().__init__(request, directory, record_path, directory.work(artifact.name) / f"{record_path.stem}.lock", items)

    def refresh(self) -> None:
        self.shard: Shard | None = None
        with suppress(StoreError):
            self.shard = Shard(self.path.parent, self.artifact, read_record(self.record_path, ShardRecord))
        self.record = self.shard.record if self.shard else None

    def prepare(self) -> "ShardPlan":
        """Plan a unit per object; an `InvalidInput` says that the shard is of another manifest, with objects that this one lacks."""
        super().prepare()
        items, self.total, manifest, only = list(self.objects), len(self.objects), self.request.manifest, self.request.only
        if self.record is not None and self.record.manifest != manifest:  # it may be forgotten
            named = {item.object_id for item in self.request.objects}
            if lost := [row.object_id for row in self.record.rows if row.object_id not in named]:
                raise InvalidInput(
                    f"{self.path} is of manifest {self.record.manifest}; {manifest} lacks {pluralise(len(lost))} of it "
                    f"({abbreviate(lost)}); name that --manifest (make: MANIFEST=), or another --data (make: DATA=)"
                )
        if only is not None:
            included = {only, *(self.shard.position if self.shard else ())}
            self.missing = tuple(item.object_id for item in items if item.object_id not in included)
            items = [item for item in items if item.object_id in included]
        check_origins(self.directory, self.stage.reads(self.settings), {item.object_id for item in items})
        labels = None
        if items:  # a shard without objects reads nothing, whether or not its inputs have been made
            labels = self._labels(items[0].object_id)
            roots = {collection.artifact.name: collection.shard(items[0].object_id).attributes for collection in self.inputs}
            with description_errors(self.stage):
                self.settings = self.stage.resolve_settings(self.settings, roots)
                self.stage.check_inputs(self.settings, roots)
        self.units = [self._unit(item) for item in items]
        self.requested = [unit for unit in self.units if only in (None, unit.name)]
        rows = [(unit.key, unit.split) for unit in self.units]
        lacks = {"missing": self.missing} if self.missing else {}
        labelled = {"labels": digest.of_arrays(labels)} if labels else {}
        self.key = digest.of_json({"rows": rows, "shard": [self.number, self.shards], "manifest": manifest, **lacks, **labelled})
        return self

    def _labels(self, object_id: str) -> Row:
        """Read the labels of dimensions from the inputs' shards of the same number, which hold this object: others may be out of date."""
        labels = [name for name, array in self.artifact.arrays.items() if array.is_coordinate]
        shards = [collection.shard(object_id) for collection in self.inputs]
        return {name: shard.read(name) for shard in shards for name in labels if shard.has(name)}

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
            if files := [path for path in self.stage.files(self.settings, item) if path.is_file()]:  # the stage reports a missing one
                origin = {**inputs, "files": keys.assets_digest(files)}
        else:
            try:
                origin = {"source": keys.source_key(item.source)}
            except (OSError, InvalidInput) as error:
                origin = {"unreadable": str(error)}
                failure = Failure(stage=self.stage.name, reason=f"its file cannot be read: {error}; fix or remove it")
        key = digest.of_json({"stage": self.stage_key, "object": item.object_id, "category": item.category, "inputs": origin})
        return Unit(item.object_id, key, inputs, self.request.seed, item.category, item.split, item.source, failure)

    def _is_retried(self, name: str, failure: Failure | None) -> bool:
        """Check whether an object failed in this stage and is processed again."""
        return failure is not None and failure.stage == self.stage.name and self.request.retry and self.request.only in (None, name)

    def _waiting(self, unit: Unit) -> Result | None:
        """Find the result of a unit that waits to be published; None if there is none yet, or it is a failure to retry."""
        if unit.failure:
            return Result(name=unit.name, key=unit.key, digest=row_digest({}, unit.failure, unit.category), failure=unit.failure)
        result = self.rows.find(unit.name, unit.key)
        return None if result is None or self._is_retried(unit.name, result.failure) else result

    def _published(self, unit: Unit) -> Shard | None:
        """Find the shard with the published row of a unit; None if there is none with its key, or it is a failure to retry."""
        shards = [self.shard]
        if self.elsewhere and unit.name in (collection := self.elsewhere.collection(self.artifact)):
            shards.append(collection.shard(unit.name))
        for shard in shards:
            row = shard.row(unit.name) if shard and unit.name in shard.position else None
            if row and row.key == unit.key and not self._is_retried(unit.name, row.failure):
                return shard
        return None

    def _reuse(self, unit: Unit) -> Result | None:
        """Find a row to reuse: one that waits, or the published one, unless it is damaged."""
        result, shard = self._waiting(unit), self._published(unit)
        if result or shard is None:
            return result
        with suppress(StoreError):
            row = shard.row(unit.name)
            reused = Result(name=unit.name, key=unit.key, seconds=row.seconds, processor=row.processor, failure=row.failure)
            return self.rows.save(reused, RowView(shard, unit.name).verify(), unit.category)
        return None

    def up_to_date(self) -> bool:
        if not self.units:
            return not exists(self.record_path)
        shard = self.shard
        if shard is None or shard.record.key != self.key:
            return False
        if any(self._is_retried(row.object_id, row.failure) for row in shard.record.rows):
            return False
        return not problems_of(shard) if self.request.check else shard.is_complete()

    def _existing(self) -> Collection:
        """Open all shards of the artifact; none if one is damaged or of another version, and must be made again."""
        try:
            return self.directory.collection(self.artifact)
        except StoreError:
            return Collection(self.path.parent, self.artifact, [])

    def current(self) -> Made:
        failures = {row.object_id: row.failure for row in self.record.rows} if self.record else {}
        return self.answer(f"up to date, {pluralise(len(self.units))}", failures)

    def answer(self, text: str, failures: Mapping[str, Failure | None] | None = None, end: str = "", **facts: Any) -> Made:
        """Say what was made, and which of the requested objects failed."""
        failed = {unit.name: failure for unit in self.requested if (failure := (failures or {}).get(unit.name)) is not None}
        here = {name: failure for name, failure in failed.items() if failure.stage == self.stage.name}
        before = len(failed) - len(here)
        text += f", {len(here)} failed" if here else ""
        text += f"; {pluralise(before)} failed in an earlier stage" if before else ""
        return super().answer(text + end, failures=here, **facts)

    def estimate(self) -> tuple[int, float, float]:
        """Estimate a run from the seconds that objects took before, else from the stage's own estimate."""
        pending = sum(self._waiting(unit) is None and self._published(unit) is None for unit in self.requested)
        cost = self.stage.cost(self.settings)
        same = [shard.record for shard in self._existing().shards if shard.record.settings == self.settings.results()]
        seconds = [row.seconds for record in same for row in record.rows if row.failure is None]
        mean = sum(seconds) / len(seconds) if seconds else cost.seconds
        return pending, pending * mean / self.request.executor.processes, self.total * cost.kilobytes

    def intent(self, objects: int, cost: str) -> str:
        if not self.total:
            return f"would be removed, {NO_OBJECT_LEFT}"
        if not objects:
            return f"would {'verify' if self.request.check else 'publish'} {pluralise(self.total, 'finished row')}, {cost}"
        uncounted = "; damaged rows are not counted" if self.request.check and objects < self.total else ""
        return f"would make {objects} of {pluralise(self.total)}, {cost}{uncounted}"

    def remarks(self) -> Iterator[str]:
        """Report published rows whose objects have left the manifest or change their split, and what does not fit the stage."""
        splits = {unit.name: unit.split for unit in self.units}
        rows = self.record.rows if self.record and self.request.only is None and self.units else ()
        gone = [row.object_id for row in rows if row.object_id not in splits]
        moved = sum(row.split != splits.get(row.object_id, row.split) for row in rows)
        lines = [f"{pluralise(len(gone))} no longer in the manifest ({abbreviate(gone)}), whose rows are dropped"] if gone else []
        lines += [f"{pluralise(moved)} in another split than before"] if moved else []
        if lines:
            yield f"{self.stage.name} {self.path}: {'; '.join(lines)}"
        units = [unit for unit in self.requested if not unit.failure]
        objects = ((unit.name, {inputs.artifact.name: inputs.view(unit.name) for inputs in self.inputs}) for unit in units)
        yield from self.stage.describe_misfits(self.settings, objects) if units else ()

    def fill(self, console: Console) -> Made:
        """Process pending units, then publish.

        With `only`, nothing is published if readers would lose a row that must be made again first, or that cannot be read.
        """
        only = self.request.only
        self.directory.set_shard_count(self.shards)
        existing = self._existing()
        if len(existing) and not any(item.object_id in existing for item in self.request.objects):  # two folders may have one name
            raise StoreError(
                f"{self.path.parent} holds other objects ({abbreviate(list(existing))}), and none of manifest "
                f"{self.request.manifest}; name another --data (make: DATA=), or delete it"
            )
        if not self.units:
            withdraw(self.record_path)
            return self.answer(f"removed, {NO_OBJECT_LEFT}")
        results: dict[str, Result] = {}
        for unit in self.units:
            if result := self._reuse(unit):
                self._check_strictness(result)
                results[unit.name] = result
        published = self.shard.position if self.shard else {}
        copied = sum(result.failure is None for name, result in results.items() if name not in published) if self.request.reuse else 0
        began, made = time.perf_counter(), 0
        for result in self._process([unit for unit in self.requested if unit.name not in results], console):
            results[result.name] = result
            made += result.failure is None
        seconds = time.perf_counter() - began
        end, notes = "", ()
        loses_rows = not self.shard.position.keys() <= results.keys() if self.shard else exists(self.record_path)
        if only is not None and loses_rows:
            end = f"; {HELD_BACK}: run without --object, or, to look at {only} alone, run each stage from the first with another --data"
        else:
            self._publish([results[unit.name] for unit in self.units])
            end = f"; {pluralise(len(self.missing))} of {self.total} not made yet" if self.missing else ""
            usable = self.shard is not None and any(row.failure is None for row in self.shard.record.rows)  # else it may lack arrays
            notes = tuple(self.stage.describe_shard(self.settings, self.shard)) if usable else ()
        failures = {name: result.failure for name, result in results.items()}
        text = (f"reused {pluralise(copied, 'row')}, " if copied else "") + f"made {pluralise(made)} in {seconds:.1f} s"
        return self.answer(text, failures, end, objects=made, seconds=seconds, notes=notes)

    def _process(self, units: list[Unit], console: Console) -> Iterator[Result]:
        """Process units; raise a bug in one of them, or the change of a file, at the end, when the others are done."""
        work = Work(self.stage, cast(ObjectSettings, self.settings), self.request.data, self.model_digests, self.assets)
        bugs, changed, items = [], [], {item.object_id: item for item in self.objects}
        with Meter(console, self.stage.name, len(units), "objects") as meter:
            for result in self.request.executor.run(work, units) if units else ():
                meter.advance()
                if result.bug:
                    bugs.append(result)
                elif self._unit(items[result.name]).key != result.key:
                    remove(self.rows.path(result.name, result.key))  # a file of the object is another one now: the row may be of either
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

    def _check_strictness(self, result: Result) -> None:
        failure, only = result.failure, self.request.only
        if self.request.strict and failure and failure.stage == self.stage.name and only in (None, result.name):
            raise InvalidInput(f"{result.name}: {failure.reason} (--strict: stopped at the first failure)")

    def _publish(self, results: list[Result]) -> None:
        stage, artifact = self.stage, self.artifact
        rows = tuple(result.record(unit.category, unit.split, unit.inputs) for unit, result in zip(self.units, results, strict=True))
        constants = conform(artifact, self._labels(self.units[0].name) | stage.constants(self.settings), constants=True)
        check_assets(stage, self.settings, self.assets)  # attributes and constants were read just now
        record = ShardRecord(
            **self.provenance(),
            schema_version=artifact.version,
            rows=rows,
            missing=self.missing,
            constants_digest=digest.of_arrays(constants),
            metadata={},
        )
        commit_shard(self.directory, artifact, self.record_path, record, results, constants, stage.attributes(self.settings))
        self.refresh()
