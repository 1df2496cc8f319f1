"""The plan of an object stage for one shard: a job per object, done by an executor, then packed into one group."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.config.settings import ObjectSettings
from pipeline.console import Meter, counted, few
from pipeline.engine import keys
from pipeline.engine.jobs import Job, Outcome, Work
from pipeline.engine.plan import Forecast, Plan, Request, Result, description_errors
from pipeline.engine.stage import ObjectStage
from pipeline.errors import BugFound, InvalidInput, StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.directory import shard_name
from pipeline.store.pieces import PieceFacts, Pieces
from pipeline.store.publish import publish_shard, withdraw
from pipeline.store.record import Failure, RowRecord, ShardRecord, read_record
from pipeline.store.reshard import shard_key, shard_of
from pipeline.store.rows import Row, conform, row_digest
from pipeline.store.shard import Shard
from pipeline.store.storage import Place, exists
from pipeline.store.validate import problems_of
from pipeline.store.write import RowToPack


@dataclass(frozen=True)
class Member:
    """An object of the shard: the job that makes its row, or why there will be none."""

    item: Object
    job: Job
    failure: Failure | None = field(default=None)


class ShardPlan(Plan[ObjectStage]):
    """A shard that an object stage makes."""

    def __init__(self, request: Request[ObjectStage], number: int, shards: int) -> None:
        super().__init__(request)
        self.number, self.shards = number, shards
        self.artifact = self.stage.output
        self.pieces = Pieces(self.directory.work(self.artifact.name))
        items = [item for item in request.objects if shard_of(item.object_id, shards) == number]
        self.directory.check_origins(
            [*(collection.artifact.name for collection in self.inputs), *self.models], {item.object_id for item in items}
        )
        if items:  # a shard without objects reads nothing, whether or not its inputs have been made
            # the rows of a shard come from those of the same number
            roots = {collection.artifact.name: collection.shard(items[0].object_id).attributes for collection in self.inputs}
            with description_errors(self.stage):
                self.settings = self.stage.settle(self.settings, roots)
                self.stage.check_inputs(self.settings, roots)
        self.members = [self._from_inputs(item) if self.inputs else self._from_source(item) for item in items]

    @property
    def path(self) -> Place:
        """The record's path without its suffix."""
        return self.directory.root / self.artifact.name / shard_name(self.number, self.shards)

    @property
    def record_path(self) -> Place:
        """Where the record of the shard is, if it is published."""
        return self.directory.shard_record(self.artifact.name, self.number, self.shards)

    @property
    def lock(self) -> Place:
        """Beside the pieces of the artifact."""
        return self.directory.shard_lock(self.artifact.name, self.number, self.shards)

    @cached_property
    def key(self) -> str:
        """The hash of the rows' keys and splits, and of which shard it is: where only splits change, nothing is computed, only packed."""
        rows = ((member.job.key, member.item.split) for member in self.members)
        return shard_key(rows, self.number, self.shards, self.request.manifest)

    @property
    def schema(self) -> list[object]:
        """The artifact's."""
        return [self.artifact.name, self.artifact.version]

    @property
    def total(self) -> int:
        """The objects of the shard."""
        return len(self.members)

    def _from_source(self, item: Object) -> Member:
        """Plan an object of a stage that reads the manifest's sources."""
        try:
            return Member(item, self._job(item, {"source": keys.source_key(item.source)}, {}))
        except (OSError, InvalidInput) as error:
            failure = Failure(stage=self.stage.name, reason=f"its file cannot be read: {error}; mend or remove it")
            return Member(item, self._job(item, {"unreadable": str(error)}, {}), failure)

    def _from_inputs(self, item: Object) -> Member:
        """Plan an object of a stage that reads earlier stages' rows."""
        rows = {collection.artifact.name: collection.row(item.object_id) for collection in self.inputs}
        digests = {name: row.digest for name, row in rows.items()}
        failure = next((row.failure for row in rows.values() if row.failure), None)
        files = [path for path in self.stage.files(item.source) if path.is_file()]  # of one that is missing the stage says so
        return Member(item, self._job(item, {**digests, "files": keys.assets_digest(files)} if files else digests, digests), failure)

    def _job(self, item: Object, origin: Mapping[str, object], inputs: dict[str, str]) -> Job:
        return Job(item, keys.object_key(self.stage_key, item.object_id, item.category, origin), inputs)

    # ---- what is there

    def look_again(self) -> None:
        """Forget what was published when it was last looked at."""
        self.__dict__.pop("published", None)

    @cached_property
    def published(self) -> Shard | None:
        """The shard that readers see, None where there is none that can be used."""
        try:
            return Shard(self.record_path.parent, self.artifact, read_record(self.record_path, ShardRecord))
        except StoreError:
            return None

    def _published_before(self) -> Collection:
        """All shards of the artifact; none where one is damaged or of another version, and is to be made again."""
        try:
            return self.directory.collection(self.artifact)
        except StoreError:
            return Collection(self.path.parent, self.artifact, [])

    def up_to_date(self) -> bool:
        """Whether the shard is there, complete, made under the same key, with no failure that is to be tried again."""
        if not self.members:
            return not exists(self.record_path)
        shard = self.published
        if shard is None or shard.record.key != self.key:
            return False
        if self.request.retry and any(self._is_own(row.failure) for row in shard.record.rows):
            return False
        return not any(problems_of(shard)) if self.request.check else shard.is_complete()

    def failures(self) -> dict[str, Failure]:
        """The objects that failed in this stage, with their reasons: as it would do them now, packed or not."""
        found = {member.item.object_id: self._failure(member) for member in self.members}
        return {object_id: failure for object_id, failure in found.items() if failure and self._is_own(failure)}

    def _failure(self, member: Member) -> Failure | None:
        """Why an object has no row; None where it has one, or none was made yet under its key."""
        if (facts := self.facts(member)) is not None:
            return facts.failure
        if self.published is None or member.item.object_id not in self.published.position:
            return None
        row = self.published.row(member.item.object_id)
        return row.failure if row.key == member.job.key else None

    def facts(self, member: Member) -> PieceFacts | None:
        """What became of an object, None where that is not known yet."""
        if member.failure:
            return PieceFacts(row_digest({}, member.failure, member.item.category), 0.0, {}, member.failure)
        return self.pieces.facts(member.item.object_id, member.job.key)

    def missing(self) -> list[Member]:
        """The members that are asked for and whose row is neither published under its key nor waiting to be packed."""
        return [member for member in self._unfinished() if not self._is_kept(member)]

    def _unfinished(self) -> list[Member]:
        """The members that are asked for and of which it is not known what became."""
        asked = (member for member in self.members if self.request.only in (None, member.item.object_id))
        return [member for member in asked if self.facts(member) is None]

    def row(self, member: Member) -> Mapping[str, np.ndarray] | None:
        """Read the row of an object that was made under its job's key, packed or not; None where there is none."""
        if (facts := self.facts(member)) is not None:
            return None if facts.failure else self.pieces.load(member.item.object_id, member.job.key, member.item.category, facts)
        shard = self.published if self._is_kept(member) else None
        return None if shard is None or shard.row(member.item.object_id).failure else shard.view(member.item.object_id)

    def _is_kept(self, member: Member) -> bool:
        """Whether the published shard has the object's row under the current key, so that it need not be made again."""
        if self.published is None or member.item.object_id not in self.published.position:
            return False
        row = self.published.row(member.item.object_id)
        return row.key == member.job.key and not (self._is_own(row.failure) and self._tried_again(member))

    def _is_own(self, failure: Failure | None) -> bool:
        return failure is not None and failure.stage == self.stage.name

    def _tried_again(self, member: Member) -> bool:
        return self.request.retry and self.request.only in (None, member.item.object_id)

    def forecast(self) -> Forecast:
        """From what objects took here before, else from what the stage says of itself."""
        typical, done = self.stage.cost(self.settings), self.up_to_date()
        missing = 0 if done else len(self.missing())
        same = [shard for shard in self._published_before().shards if shard.record.settings == self.settings.results()]
        seconds = [row.seconds for shard in same for row in shard.record.rows]
        mean = sum(seconds) / len(seconds) if seconds else typical.seconds
        return Forecast(missing, self.total, missing * mean / self.request.executor.processes, self.total * typical.kilobytes, done)

    # ---- making it

    def make(self, console: Console) -> Result:
        """Process what is missing, then pack and publish; with `only`, the shard is packed only if that was all that was missing.

        A shard that has no objects any more is withdrawn.
        """
        self.directory.claim_shards(self.shards)
        self._refuse_strangers()
        if not self.members:  # the objects that it had are gone
            withdraw(self.record_path)
            return Result()
        self._forget_failures()
        self._keep_rows()
        self._refuse_failures()
        result = self._process(self._unfinished(), console)
        unfinished = [member.item.object_id for member in self.members if self.facts(member) is None]
        began = time.perf_counter()
        if not unfinished:
            self._publish()
        elif self.request.only is None:
            raise StoreError(f"{self.path}: rows are gone, that of {unfinished[0]} first: did another run pack them? Run again")
        return replace(result, packing=time.perf_counter() - began, waiting=len(unfinished))

    def _refuse_strangers(self) -> None:
        """A data directory of other objects would be lost: two folders of meshes go by one name, or a manifest was forgotten."""
        if (own := self.published) is not None and own.record.manifest != self.request.manifest:
            asked = {member.item.object_id for member in self.members}
            if lost := [name for name in own.position if name not in asked]:
                raise StoreError(
                    f"{self.path} is of manifest {own.record.manifest}; {self.request.manifest} lacks {counted(len(lost))} of it "
                    f"({few(lost)}); name that --manifest (make: MANIFEST=), or another --data (make: DATA=)"
                )
        there = self._published_before()
        if len(there) and not any(item.object_id in there for item in self.request.objects):
            raise StoreError(
                f"{self.path.parent} holds other objects ({few(list(there))}), and none of manifest "
                f"{self.request.manifest}; name another --data (make: DATA=), or delete it"
            )

    def _forget_failures(self) -> None:
        for member in self.members:
            if self._tried_again(member):
                facts = self.pieces.facts(member.item.object_id, member.job.key)
                if facts and facts.failure:
                    self.pieces.discard(member.item.object_id, member.job.key)

    def _keep_rows(self) -> None:
        """Take rows of the published shard that have the current key to the pieces; one that is damaged is made again."""
        for member in self.members:
            if (shard := self.published) and self._is_kept(member) and self.facts(member) is None:
                row = shard.row(member.item.object_id)
                with suppress(StoreError):
                    values = shard.view(row.object_id).verify()
                    kind = shard.record.processor_of(row)
                    self.pieces.save(row.object_id, row.key, row.category, values, seconds=row.seconds, failure=row.failure, processor=kind)

    def _refuse_failures(self) -> None:
        for member in self.members if self.request.strict else ():
            if (facts := self.facts(member)) and facts.failure:
                raise InvalidInput(_strictly(member.item.object_id, facts.failure.reason))

    def _process(self, missing: list[Member], console: Console) -> Result:
        """Process objects; a bug in one of them is told at the end, when the others are done."""
        work = Work(self.stage, cast(ObjectSettings, self.settings), self.request.seed, self.request.data, self.model_digests)
        jobs, began = [member.job for member in missing], time.perf_counter()
        outcomes: list[Outcome] = []
        with Meter(console, self.stage.name, len(jobs), "objects") as meter:
            for outcome in self.request.executor.run(work, jobs) if jobs else ():
                outcomes.append(outcome)
                meter.advance()
                if self.request.strict and outcome.failure:
                    raise InvalidInput(_strictly(outcome.object_id, outcome.failure.reason))
        if bugs := [outcome for outcome in outcomes if outcome.bug]:
            raise BugFound(
                f"{self.stage.name}: processing {', '.join(outcome.object_id for outcome in bugs)} met a bug in vt-pipeline, not a fault "
                f"of the objects. Please report it with this traceback; to continue, leave the objects out of the manifest.\n{bugs[0].bug}"
            )
        return Result(len(outcomes), sum(outcome.failure is not None for outcome in outcomes), time.perf_counter() - began)

    def _publish(self) -> None:
        facts = [found for member in self.members if (found := self.facts(member))]
        known = list(zip(self.members, facts, strict=True))
        failures = {member.item.object_id: one.failure.model_dump() for member, one in known if one.failure}
        attributes = {
            "schema": self.artifact.name,
            "schema_version": self.artifact.version,
            "stage": self.stage.name,
            "settings": self.settings.results(),
            "seed": self.request.seed,
            "manifest": self.request.manifest,
            "failures": failures,
            **self.stage.attributes(self.settings),
        }
        constants = conform(self.artifact, self._labels() | self.stage.constants(self.settings), constants=True)
        record = ShardRecord(
            **self.provenance(),
            schema_version=self.artifact.version,
            rows=tuple(self._row_record(member, one) for member, one in known),
            constants_digest=digest.of_arrays(constants),
            metadata={},
        )
        rows = [self._row_to_pack(member, one) for member, one in known]
        publish_shard(self.directory, self.artifact, self.number, self.shards, record, rows, constants, attributes)
        self._refuse_resharded()
        self.look_again()
        self.pieces.discard_all({member.item.object_id: member.job.key for member in self.members})

    def _refuse_resharded(self) -> None:
        """Where the objects were split otherwise meanwhile, nobody finds this shard; its rows are kept for the next run."""
        try:
            self.directory.settled_shards(self.shards)
        except StoreError:
            withdraw(self.record_path)
            raise

    def _labels(self) -> Row:
        """Labels of dimensions that the inputs have too."""
        wanted = [name for name, array in self.artifact.arrays.items() if array.is_coordinate]
        shards = [collection.first for collection in self.inputs]
        return {name: shard.read(name) for name in wanted for shard in shards if shard.has(name)}

    def _row_record(self, member: Member, facts: PieceFacts) -> RowRecord:
        item, job = member.item, member.job
        return RowRecord(
            object_id=item.object_id,
            category=item.category,
            split=item.split,
            key=job.key,
            digest=facts.digest,
            inputs=job.inputs,
            seconds=round(facts.seconds, 4),
            processor=facts.processor,
            failure=facts.failure,
        )

    def _row_to_pack(self, member: Member, facts: PieceFacts) -> RowToPack:
        item = member.item

        def load() -> Row:
            row = {} if member.failure else self.pieces.load(item.object_id, member.job.key, item.category, facts)
            if row is None:
                self.pieces.discard(item.object_id, member.job.key)
                raise StoreError(f"{self.pieces.path(item.object_id, member.job.key)} was damaged and is removed; run again")
            return row

        return RowToPack(item.object_id, item.category, item.split, facts.failure is None, facts.shapes, load)


def _strictly(object_id: str, reason: str) -> str:
    return f"{object_id}: {reason} (--strict stops here; without it the others go on)"
