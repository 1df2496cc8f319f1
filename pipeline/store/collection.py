"""All shards of an artifact as one collection of objects, however they are split."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.layout import Layout
from pipeline.store.shard import RowView, Shard
from schemas.base import Artifact
from schemas.catalogue import ARTIFACTS


class Collection:
    """The finished objects of an artifact in a data directory.

    While a data set is split anew, shards of two splits stand side by side. With `shards`, those of the split into so
    many go before others, and shards that cannot be opened are passed over: the run that needs one says so. Without, a
    split that stands whole goes before others, and a shard that cannot be opened is an error.
    """

    def __init__(self, layout: Layout, artifact: Artifact, shards: int | None = None) -> None:
        self.layout = layout
        self.artifact = artifact
        self.unusable: list[str] = []
        found = []
        for _, path in layout.shards(artifact.name):
            try:
                found.append(Shard(path, artifact))
            except StoreError as error:
                if shards is None:
                    raise
                self.unusable.append(str(error))
        self.shards = _first_choice_last(found, shards)
        self._shard_of = {object_id: shard for shard in self.shards for object_id in shard.object_ids}

    def __contains__(self, object_id: object) -> bool:
        return object_id in self._shard_of

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._shard_of))

    def __len__(self) -> int:
        return len(self._shard_of)

    def shard(self, object_id: str) -> Shard:
        """The shard that holds an object."""
        try:
            return self._shard_of[object_id]
        except KeyError:
            where, why = self.layout.root / self.artifact.name, "".join(f" ({line})" for line in self.unusable)
            raise StoreError(f"{where} has no object {object_id}{why}; run the stage that makes {self.artifact.name} first") from None

    def view(self, object_id: str) -> RowView:
        """An object's row."""
        return self.shard(object_id).view(object_id)

    def digest(self) -> str:
        """The digest of every object in it: equal however they are split, and whatever versions made them."""
        shards = {digest.of_json(_shared(shard)) for shard in self.shards}
        rows = [(name, f"{shard.row_digest(name)} {shard.split(name)}") for name, shard in self._shard_of.items()]
        return digest.of_rows(rows, {"shared": sorted(shards)})

    def stale(self, others: Sequence[Collection]) -> str | None:
        """An object whose row here was made from another row than stands in one of the other collections, with words for it."""
        for other in others:
            name = other.artifact.name
            for object_id, shard in self._shard_of.items():
                used = shard.input_digests(object_id).get(name)
                if used is not None and (object_id not in other or other.shard(object_id).row_digest(object_id) != used):
                    return f"{self.artifact.name} of {object_id} was made from other {name} than stand there now; run its stage again"
        return None


def with_origins(collections: Sequence[Collection], shards: int | None = None) -> list[Collection]:
    """The collections, and whatever stands beside them that they were made from, directly or by way of others."""
    found = {collection.artifact.name: collection for collection in collections}
    asked = list(collections)
    while asked:
        collection = asked.pop()
        for name in {name for shard in collection.shards for made_from in shard.attributes["input_digests"] for name in made_from}:
            if name not in found and name in ARTIFACTS and collection.layout.shards(name):
                found[name] = Collection(collection.layout, ARTIFACTS[name], shards)
                asked.append(found[name])
    return list(found.values())


def check_origins(collections: Sequence[Collection]) -> None:
    """A `StoreError` where a row was made, directly or by way of others, from another row than stands there now."""
    everything = with_origins(collections)
    for collection in everything:
        if stale := collection.stale(everything):
            raise StoreError(stale)


def usable_objects(collections: Mapping[str, Collection], split: str | None) -> tuple[list[str], dict[str, str]]:
    """The objects of a split, all for None, in id order; and those that failed in one of the collections, with stage and reason."""
    found, left_out = [], {}
    first = next(iter(collections.values()))
    for object_id in first:
        if split not in (None, first.shard(object_id).split(object_id)):
            continue
        failures = [failure for other in collections.values() if (failure := other.shard(object_id).failure(object_id))]
        if failures:
            left_out[object_id] = f"{failures[0]['stage']}: {failures[0]['reason']}"
        else:
            found.append(object_id)
    return found, left_out


def _first_choice_last(found: list[Shard], shards: int | None) -> list[Shard]:
    """The shards in an order in which later ones go before earlier ones; a whole split stands alone."""
    counts = {int(shard.attributes["shards"]) for shard in found}
    for count in counts if shards is None else ():
        split = [shard for shard in found if shard.attributes["shards"] == count]
        if len(split) == count:
            return split
    return sorted(found, key=lambda shard: shard.attributes["shards"] == shards)


_APART = {
    *("stage", "key", "object_keys", "input_digests", "digests", "failures", "shard", "shards", "complete"),
    *("seconds", "versions", "speed_settings", "preset"),
}
"""Attributes that belong to one shard, or say when, with what and how fast it was made."""


def _shared(shard: Shard) -> dict[str, object]:
    """What all shards of an artifact have in common."""
    return {name: value for name, value in shard.attributes.items() if name not in _APART}
