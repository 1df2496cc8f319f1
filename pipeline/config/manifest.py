"""Manifests: which objects a dataset is made of, where their meshes come from, and how they are split."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pipeline.config.complaints import complaints
from pipeline.config.sources import Directory, Found, Procedural, Pybullet, ShapeNet
from pipeline.errors import ManifestError

SPLITS = ("train", "valid", "test")
OBJECT_ID = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,120}")
"""What names an object: it also names files and Zarr groups."""


class Splits(BaseModel):
    """How many objects go to each split: shares that sum to 1, or counts that sum to the number of objects."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    train: float = Field(ge=0)
    valid: float = Field(ge=0)
    test: float = Field(ge=0)

    @property
    def are_counts(self) -> bool:
        """Whether these are counts."""
        return self.train + self.valid + self.test > 1 + 1e-9

    @model_validator(mode="after")
    def _sum(self) -> Splits:
        total = self.train + self.valid + self.test
        if not self.are_counts and abs(total - 1) > 1e-9:
            raise ValueError(f"shares sum to {total:g}; they must sum to 1 (or be counts)")
        if self.are_counts and not all(float(n).is_integer() for n in (self.train, self.valid, self.test)):
            raise ValueError("counts must be whole numbers")
        return self


class Manifest(BaseModel):
    """A dataset's objects, as its YAML file states them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    description: str
    seed: int = Field(ge=0)
    splits: Splits
    sources: tuple[Annotated[Procedural | Pybullet | Directory | ShapeNet, Field(discriminator="kind")], ...] = Field(min_length=1)

    def objects(self, root: Path | None = None) -> list[Object]:
        """Every object in id order, with its category, source and split.

        `root` is the folder of meshes for sources that name none.

        Raises
        ------
        ManifestError
            No objects, a folder or file that is not there, an id that repeats or cannot name a file, counts that do
            not match: with the place that was looked at and the way out.
        """
        found: dict[str, Found] = {}
        for source in self.sources:
            try:
                listed = source.find(root)
            except (OSError, ValueError) as error:
                raise ManifestError(f"manifest {self.name}: {error}") from error
            for item in listed:
                if not OBJECT_ID.fullmatch(item.object_id) or item.object_id == "zarr.json":
                    rule = "up to 120 letters, digits, '.', '_', '-' can, the first no '.'"
                    raise ManifestError(f"manifest {self.name}: {item.object_id!r} cannot name an object; {rule}")
                if item.object_id in found:
                    both = f"{found[item.object_id].source.get('file', 'one')} and {item.source.get('file', 'another')}"
                    raise ManifestError(f"manifest {self.name}: two objects are called {item.object_id}: {both}; rename one")
                found[item.object_id] = item
        if not found:
            raise ManifestError(f"manifest {self.name} names no objects; give its sources some")
        items = [found[name] for name in sorted(found)]
        splits = self._split(items)
        return [Object(item.object_id, item.category, splits[item.object_id], item.source) for item in items]

    def _split(self, items: Sequence[Found]) -> dict[str, str]:
        """The split of every object: by seed and id, each category spread evenly over the splits."""
        wanted = (self.splits.train, self.splits.valid, self.splits.test)
        if self.splits.are_counts and sum(wanted) != len(items):
            counts = " + ".join(f"{count:g}" for count in wanted)
            raise ManifestError(
                f"manifest {self.name}: the splits count {counts} = {sum(wanted):g} objects, {len(items)} were found; "
                "complete the folder, or state shares that sum to 1 in a manifest of your own"
            )
        by_category: dict[str, list[tuple[str, str]]] = {}
        for item in items:
            lot = hashlib.sha256(f"{self.seed}\0split\0{item.object_id}".encode()).hexdigest()
            by_category.setdefault(item.category, []).append((lot, item.object_id))
        order = sorted(
            ((rank + 0.5) / len(drawn), lot, object_id)
            for drawn in by_category.values()
            for rank, (lot, object_id) in enumerate(sorted(drawn))
        )
        scale = 1 if self.splits.are_counts else len(items)
        ends = [round(wanted[0] * scale), round((wanted[0] + wanted[1]) * scale)]
        return {object_id: SPLITS[sum(place >= end for end in ends)] for place, (_, _, object_id) in enumerate(order)}


class Object:
    """One object of a manifest: its id, category, split, and where its mesh comes from."""

    __slots__ = ("category", "object_id", "source", "split")

    def __init__(self, object_id: str, category: str, split: str, source: dict[str, Any]) -> None:
        self.object_id = object_id
        self.category = category
        self.split = split
        self.source = source


def built_in() -> list[str]:
    """Names of the manifests that come with the package."""
    folder = resources.files("data_manifests")
    return sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def load_manifest(name_or_path: str) -> Manifest:
    """Read a manifest: one of the built-in names, or the path of a YAML file.

    Raises
    ------
    ManifestError
        No such manifest; not YAML; a key unknown or missing; a value out of its limits.
    """
    path = Path(name_or_path)
    if name_or_path not in built_in() and not path.is_file():
        raise ManifestError(f"there is no manifest {name_or_path}; built in are {', '.join(built_in())}, or give a YAML file")
    file = resources.files("data_manifests").joinpath(f"{name_or_path}.yaml") if name_or_path in built_in() else path
    try:
        text = file.read_text(encoding="utf-8")
        return Manifest.model_validate(yaml.safe_load(text))
    except ValidationError as error:
        raise ManifestError(f"manifest {name_or_path}: {complaints(error)}") from error
    except (yaml.YAMLError, OSError, UnicodeDecodeError) as error:
        raise ManifestError(f"manifest {name_or_path}: {error}") from error


def shard_of(objects: Sequence[Object], shard: int, shards: int) -> list[Object]:
    """The objects of one shard: consecutive in id order, shards equal in size to within one."""
    return list(objects[len(objects) * shard // shards : len(objects) * (shard + 1) // shards])
