"""Reading a finished shard, object by object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.spec import numpy_dtype
from schemas.base import COMMON, Artifact


class Shard:
    """A finished shard, open for reading."""

    def __init__(self, path: Path, artifact: Artifact) -> None:
        self.path = path
        self.artifact = artifact
        try:
            self.group = zarr.open_group(str(path), mode="r")
        except (OSError, ValueError, KeyError) as error:
            raise StoreError(f"{path}: no Zarr group can be read there ({error}); run its stage again") from error
        self.attributes: Mapping[str, Any] = self.group.attrs.asdict()
        if self.attributes.get("complete") is not True:
            raise StoreError(f"{path}: the shard is not marked complete; run its stage again")
        if self.attributes.get("schema_version") != artifact.version:
            raise StoreError(
                f"{path}: schema {artifact.name} is version {artifact.version} here, the shard has "
                f"{self.attributes.get('schema_version')}; run its stage again"
            )

    @cached_property
    def object_ids(self) -> list[str]:
        """The objects of this shard, in order."""
        try:
            return [str(name) for name in self.array("object_id")[:]]
        except (KeyError, OSError) as error:
            raise StoreError(
                f"{self.path}: object_id cannot be read ({error}); is a run replacing the shard? Else delete it and run again"
            ) from error

    @cached_property
    def rows(self) -> dict[str, int]:
        """The row of every object."""
        return {name: row for row, name in enumerate(self.object_ids)}

    def array(self, name: str) -> Any:
        """A stored array, by its path below the root; those of the root itself are opened once.

        A `StoreError` where one of its files is gone: Zarr would read zeros in its place.
        """
        array: Any = self.group[name] if "/" in name else self._root_arrays[name]
        if name not in self._whole:
            files = math.prod(math.ceil(size / part) for size, part in zip(array.shape, array.shards or array.chunks, strict=True))
            chunks = self.path / name / "c"
            lost = files - sum(path.is_file() for path in [chunks, *chunks.rglob("*")])
            if lost > 0:
                raise StoreError(f"{self.path}: {name} has lost {lost} of its {files} files; delete the shard and run its stage again")
            self._whole.add(name)
        return array

    @cached_property
    def _whole(self) -> set[str]:
        """The arrays all of whose files stand."""
        return set()

    def has(self, name: str) -> bool:
        """Whether an array stands at the root: not every artifact has all that its schema allows."""
        return name in self._root_arrays

    @cached_property
    def _root_arrays(self) -> dict[str, Any]:
        return dict(self.group.arrays())

    @cached_property
    def _splits(self) -> list[str]:
        return [str(name) for name in self.array("split")[:]]

    def split(self, object_id: str) -> str:
        """The split an object belongs to."""
        return self._splits[self.rows[object_id]]

    def row_digest(self, object_id: str) -> str:
        """The digest of an object's row, as it was when it was made."""
        return str(self.attributes["digests"][self.rows[object_id]])

    def input_digests(self, object_id: str) -> Mapping[str, str]:
        """The digests of the rows that an object's row was made from, by artifact."""
        digests: dict[str, str] = self.attributes["input_digests"][self.rows[object_id]]
        return digests

    def object_key(self, object_id: str) -> str:
        """The key under which an object's row was made."""
        return str(self.attributes["object_keys"][self.rows[object_id]])

    def failure(self, object_id: str) -> dict[str, str] | None:
        """The stage and reason of an object's failure, None where it was processed."""
        failure: dict[str, str] | None = self.attributes["failures"].get(object_id)
        return failure

    def view(self, object_id: str) -> RowView:
        """An object's row, read array by array when asked for."""
        return RowView(self, object_id)


class RowView(Mapping[str, np.ndarray]):
    """One object's row as a mapping from array names to arrays; ragged ones as `meshes/vertices`.

    Arrays are read when asked for; once the row's digest was taken, they are those that it was taken of.
    """

    def __init__(self, shard: Shard, object_id: str) -> None:
        self.shard = shard
        self.object_id = object_id
        self._held: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self._held:
            return self._held[name]
        declared = self.shard.artifact.of(name)
        if declared is None:
            raise KeyError(f"{self.shard.artifact.name} has no array {name}")
        if "/" in name:
            group, leaf = name.split("/")
            return np.asarray(self.shard.array(f"{group}/{self.object_id}/{leaf}")[...])
        if not declared.per_object:
            return np.asarray(self.shard.array(name)[...])
        value = self.shard.array(name)[self.shard.rows[self.object_id]]
        return np.array(str(value)) if declared.dtype == "string" else np.asarray(value, numpy_dtype(declared))

    def row(self) -> dict[str, np.ndarray]:
        """What the stage returned for the object: every array of the row but those that all artifacts have."""
        return {name: self[name] for name in self if name not in COMMON}

    def digest(self) -> str:
        """The digest of the row as it is stored, which is read anew and then held; a StoreError where it cannot be read."""
        self._held = {}
        try:
            row = self.row()
        except StoreError:
            raise
        except Exception as error:  # whatever a codec raises on bytes that changed
            raise StoreError(
                f"{self.shard.path}: {self.object_id} cannot be read ({error}); delete the shard and run its stage again"
            ) from error
        self._held = row
        return row_digest(row, self.shard.failure(self.object_id), str(self["category"]))

    def __iter__(self) -> Iterator[str]:
        yield from (name for name, array in self.shard.artifact.arrays.items() if array.per_object and self.shard.has(name))
        for name in {pattern.split("/")[0] for pattern in self.shard.artifact.ragged}:
            parent = self.shard.group.get(f"{name}/{self.object_id}")
            if isinstance(parent, zarr.Group):
                yield from sorted(f"{name}/{leaf}" for leaf in parent.array_keys())

    def __len__(self) -> int:
        return sum(1 for _ in self)


def row_digest(row: Mapping[str, np.ndarray], failure: Mapping[str, str] | None, category: str) -> str:
    """The digest of one object's category and row, or of the reason why there is none."""
    return digest.of_arrays({} if failure else row, failure=dict(failure) if failure else None, category=category)
