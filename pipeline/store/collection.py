"""All shards of an artifact as one collection of objects, however they are split."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.store import digest
from pipeline.store.layout import Layout
from pipeline.store.shard import RowView, Shard, StoreError
from schemas.base import Artifact


class Collection:
    """The finished objects of an artifact in a data directory."""

    def __init__(self, layout: Layout, artifact: Artifact) -> None:
        self.layout = layout
        self.artifact = artifact
        self.shards = [Shard(path, artifact) for _, path in layout.shards(artifact.name)]
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
            where = self.layout.root / self.artifact.name
            raise StoreError(f"{where} has no object {object_id}; run the stage that makes {self.artifact.name} first") from None

    def view(self, object_id: str) -> RowView:
        """An object's row."""
        return self.shard(object_id).view(object_id)

    def digest(self) -> str:
        """The digest of every object in it: equal however they are split, and whatever versions made them."""
        shards = {digest.of_json(_shared(shard)) for shard in self.shards}
        rows = [(object_id, shard.row_digest(object_id)) for object_id, shard in self._shard_of.items()]
        return digest.of_rows(rows, {"shared": sorted(shards)})


_APART = {
    *("stage", "key", "object_keys", "digests", "failures", "shard", "shards", "complete"),
    *("seconds", "versions", "speed_settings", "preset"),
}
"""Attributes that belong to one shard, or say when, with what and how fast it was made."""


def _shared(shard: Shard) -> dict[str, object]:
    """What all shards of an artifact have in common."""
    return {name: value for name, value in shard.attributes.items() if name not in _APART}
