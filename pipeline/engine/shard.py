"""Shards: what a run of an object stage would make, and makes."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, cast

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.config.settings import ObjectSettings
from pipeline.console import Meter, abbreviate, pluralise
from pipeline.engine.plan import Made
from pipeline.engine.session import Work, check_assets
from pipeline.engine.shard_units import ShardUnits
from pipeline.engine.unit import Unit
from pipeline.errors import BugFound, InvalidInput, StageError, StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.record import Failure, ShardRecord
from pipeline.store.rows import Result, conform
from pipeline.store.storage import exists

NO_OBJECT_LEFT = "all its objects have left the manifest"
HELD_BACK = "not published, because other rows are damaged, have left the manifest, or were made with other settings, inputs or code"


class ShardPlan(ShardUnits):
    """The plan of a shard of an object stage: an executor makes the missing rows, then all are published as one group."""

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
        published = self.output.shard.position if self.output.shard else {}
        copied = sum(result.failure is None for name, result in results.items() if name not in published) if self.request.reuse else 0
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
        text = (f"reused {pluralise(copied, 'row')}, " if copied else "") + f"made {pluralise(made)} in {seconds:.1f} s"
        return self._answer(text, failures, end, objects=made, seconds=seconds, notes=notes)

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
