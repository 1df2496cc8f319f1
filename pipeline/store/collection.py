"""All shards of an artifact as one collection of objects, however many shards there are."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.record import Failure, RowRecord, ShardRecord
from pipeline.store.shard import RowView, Shard
from pipeline.store.storage import Location
from schemas.base import Artifact


class Collection:
    """The objects of an artifact whose shards have been published."""

    def __init__(self, folder: Location, artifact: Artifact, shards: Sequence[Shard]) -> None:
        self.folder = folder
        self.artifact = artifact
        self.shards = shards
        self._shard_of = {object_id: shard for shard in shards for object_id in shard.position}

    def __contains__(self, object_id: object) -> bool:
        return object_id in self._shard_of

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._shard_of))

    def __len__(self) -> int:
        return len(self._shard_of)

    def shard(self, object_id: str) -> Shard:
        """Find the shard that holds an object; raise a `StoreError` if none does."""
        try:
            return self._shard_of[object_id]
        except KeyError:
            if not self.shards:
                raise StoreError(self._not_made) from None
            record = self.shards[0].record
            raise StoreError(
                f"{self.folder}, of manifest {record.manifest}, has no object {object_id}; name that manifest, or "
                f"run `vt-pipeline run {record.stage}` first, for all objects"
            ) from None

    def row(self, object_id: str) -> RowRecord:
        """Return the record of an object's row."""
        return self.shard(object_id).row(object_id)

    @cached_property
    def missing(self) -> dict[str, Failure]:
        """The objects that incomplete shards lack, each as a failure."""
        lacking = sorted((name, shard.record.stage) for shard in self.shards for name in shard.record.missing)
        return {name: Failure(stage=stage, reason="not made yet") for name, stage in lacking}

    def failure(self, object_id: str) -> Failure | None:
        """Return the reason why an object has no row; None where it has one."""
        return self.missing.get(object_id) or self.row(object_id).failure

    def view(self, object_id: str) -> RowView:
        """Open an object's row."""
        return self.shard(object_id).view(object_id)

    @property
    def _not_made(self) -> str:
        return f"{self.folder} has not been made; run `vt-pipeline run {self.artifact.stage}` first"

    @cached_property
    def first(self) -> Shard:
        """Return the first shard with a row: others lack sizes.; settings, attributes and constants are the same in all."""
        if not self.shards:
            raise StoreError(self._not_made)
        self.check_alike()
        return next((shard for shard in self.shards if shard.has_rows), self.shards[0])

    def check_alike(self) -> None:
        """Raise a `StoreError` if shards differ in settings, seed, models or constants: they do not belong together."""
        for other in (shard.record for shard in self.shards[1:]):
            first = self.shards[0].record
            remedy = f"run `vt-pipeline run {first.stage}` for all shards"
            made, made_otherwise = _made_with(first), _made_with(other)
            if names := [name for name in {**made, **made_otherwise} if made.get(name) != made_otherwise.get(name)]:
                differences = [f"{name} {made.get(name, 'unset')} and {made_otherwise.get(name, 'unset')}" for name in names]
                numbers = " and ".join(record.location.rpartition("-")[0] for record in (first, other))
                raise StoreError(
                    f"{self.folder}: its shards {numbers} were made with different settings ({'; '.join(differences)}); "
                    f"{remedy} with the same --preset, --set and --seed"
                )
            if first.constants_digest != other.constants_digest:
                raise StoreError(f"{self.folder} has shards of different scenes or sensors; {remedy}")

    def processors(self) -> Counter[str]:
        """Count the rows by the kind of processor that computed them."""
        kinds = Counter(shard.record.processor_of(row) for shard in self.shards for row in shard.record.rows)
        return Counter({kind: count for kind, count in kinds.items() if kind})

    def digest(self) -> str:
        """Compute the digest of all objects; it depends neither on the number of shards nor on the versions that made them."""
        shared = {
            digest.of_json([shard.record.constants_digest, {k: v for k, v in shard.attributes.items() if k != "failures"}])
            for shard in self.shards
        }
        rows = ((row.object_id, f"{row.digest} {row.split}") for shard in self.shards for row in shard.record.rows)
        return digest.of_rows(rows, {"shared": sorted(shared)})

    def rows_digest(self, splits: Iterable[str]) -> str:
        """Compute the digest of what a dataset stage depends on: the rows of the splits' objects, their split, and the constants."""
        split_names = set(splits)
        rows = [(name, row.split, row.digest) for name in self if (row := self.row(name)).split in split_names]
        constants = sorted({shard.record.constants_digest for shard in self.shards})
        return digest.of_json({"rows": rows, "constants": constants})


def _made_with(record: ShardRecord) -> dict[str, str]:
    """List the settings, seed and models that a shard was made with, as texts that fit into a message."""
    settings = {name: json.dumps(value, sort_keys=True) for name, value in record.settings.items()}
    return {**settings, "--seed": str(record.seed), **{name: made_of[:16] for name, made_of in record.models.items()}}
