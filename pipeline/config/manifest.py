"""Manifests: which objects a dataset is made of, where their meshes come from, and how they are split."""

import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, PlainValidator, SerializeAsAny, model_validator

from pipeline import plugins
from pipeline.config.folder_sources import Catalogue, Directory, FolderSource, ShapeNet
from pipeline.config.sources import MeshSource, ModelledSource, Object, Pybullet, Source
from pipeline.console import CONTROLS
from pipeline.entries import Entries
from pipeline.errors import InvalidInput, unknown_name
from pipeline.formats.description_file import description_path, read_description, shipped_files
from pipeline.formats.file_content import expanded
from pipeline.formats.file_units import METRES

SPLITS = ("train", "valid", "test")
TOTAL = "all"  # what tables call all categories together
OBJECT_ID = re.compile(r"(?!\.|zarr\.json$)[A-Za-z0-9._-]{1,120}")  # it also names files, and Zarr groups, where `zarr.json` is taken


class Splits(Entries):
    """How many objects go to each split: shares that sum to 1, or counts that sum to the number of objects."""

    train: float = Field(ge=0, description="For learning.")
    valid: float = Field(ge=0, description="To choose the best epoch by.")
    test: float = Field(ge=0, description="For evaluation.")

    @property
    def are_counts(self) -> bool:
        """Whether these are counts: whole numbers that sum to more than 1."""
        return self._total > 1 + 1e-9 and all(float(n).is_integer() for n in (self.train, self.valid, self.test))

    @property
    def _total(self) -> float:
        return self.train + self.valid + self.test

    @model_validator(mode="after")
    def _sum(self) -> "Splits":
        if not self.are_counts and abs(self._total - 1) > 1e-9:
            raise ValueError(f"{self.train:g} + {self.valid:g} + {self.test:g} = {self._total:g}; shares must sum to 1, counts be whole")
        return self


def without_controls(name: str) -> str:
    """Return a name; raise an `InvalidInput` if it has control characters."""
    if match := CONTROLS.search(name):
        raise InvalidInput(f"{name!r} contains the control character {match[0]!r}; remove it")
    return name


MESH_SOURCES: dict[str, type[Source]] = {"pybullet": Pybullet, "directory": Directory, "catalogue": Catalogue, "shapenet": ShapeNet}


def _of_its_kind(entries: object) -> Source:
    """Check the entries of a source as its kind asks: one of `MESH_SOURCES`, or one that a package declares."""
    if isinstance(entries, Source):
        return entries
    kind = entries.get("kind") if isinstance(entries, dict) else None
    if kind in MESH_SOURCES:
        return MESH_SOURCES[kind].model_validate(entries)
    kinds = [*MESH_SOURCES, *(entry.name for entry in plugins.declared("sources"))]
    if kind not in kinds:
        raise ValueError(unknown_name("kind of source", str(kind), kinds) if kind else f"names no kind; write one of {', '.join(kinds)}")
    source_type: type[Source] = plugins.named("sources", kind, ModelledSource)
    return source_type.model_validate(entries)


class Manifest(Entries):
    """A dataset's objects, as its YAML file states them."""

    name: Annotated[str, AfterValidator(without_controls)] = Field(description="Of the dataset, recorded in it.")
    description: str = Field(description="For readers: which objects these are.")
    seed: int = Field(
        ge=0, description="Seed of the splits and of all random choices per object; `--seed` replaces it for the objects, not the splits."
    )
    splits: Splits = Field(description="How many objects are for what, without those whose source states its split.")
    sources: tuple[Annotated[SerializeAsAny[Source], PlainValidator(_of_its_kind)], ...] = Field(
        min_length=1, description="Where the objects come from, one or more, of any kinds."
    )

    def objects(self, root: Path | None = None) -> list[Object]:
        """List every object in id order, with its category, source and split; errors name the folder or file and the remedy.

        `root` is the folder of meshes for a source that names none, or instead of that of the only one.
        """
        sources = self._with_roots(root)
        try:
            listed = (replace(item, split=source.split or "") for source, folder in sources for item in source.find(folder))
            objects = sorted(listed, key=lambda item: item.object_id)
            _check_names(objects)
            splits = self._splits_of(objects)
        except (OSError, InvalidInput) as error:
            raise InvalidInput(f"manifest {self.name}: {error}") from error
        return [replace(item, split=splits[item.object_id]) for item in objects]

    def with_units(self, units: str | None, up: str | None) -> "Manifest":
        """Return the manifest with units, of `METRES`, for sources without any, and another up-axis for all mesh files.

        An entry of one file, in a catalogue or of PyBullet's, keeps what it states.
        """
        if units is None and up is None:
            return self
        files = [source for source in self.sources if isinstance(source, MeshSource)]
        if not files:
            raise InvalidInput(f"manifest {self.name} names no mesh files, so units and an up-axis mean nothing; leave them out")
        if units is not None and all(source.metres_per_unit is not None for source in files):
            raise InvalidInput(f"all sources of manifest {self.name} state metres_per_unit; leave --units {units} out, or correct it")
        metres = METRES[units] if units else None
        return self._with(MeshSource, lambda source: {"metres_per_unit": source.metres_per_unit or metres, "up": up or source.up})

    def _with(self, kind: Any, changes: Callable[[Any], dict[str, Any]]) -> "Manifest":
        """Return the manifest with other entries of the sources of a kind."""
        sources = [source.model_copy(update=changes(source)) if isinstance(source, kind) else source for source in self.sources]
        return self.model_copy(update={"sources": tuple(sources)})

    def remarks(self, root: Path | None = None) -> list[str]:
        """Report the recognised layout of its folders, and skipped files that look like objects."""
        return [line for source, folder in self._with_roots(root) if isinstance(source, MeshSource) for line in source.remarks(folder)]

    def _with_roots(self, root: Path | None) -> list[tuple[Source, Path | None]]:
        """Give a folder of meshes to the source that names none, or replace that of the only one that takes a folder."""
        if root is None:
            return [(source, None) for source in self.sources]
        folders = [source for source in self.sources if isinstance(source, FolderSource)]
        takers = [source for source in folders if source.path is None] or folders
        if not takers:
            raise InvalidInput(
                f"manifest {self.name} names its own objects: leave --objects (make: OBJECTS=) out, or name a manifest that takes a "
                "folder, such as directory"
            )
        if len(takers) > 1:
            remedy = "state the `path` of all but one" if takers[0].path is None else "each states its `path`, so leave --objects out"
            raise InvalidInput(f"{len(takers)} sources of {self.name} take a folder, and --objects (make: OBJECTS=) names one: {remedy}")
        return [(source, root if source is takers[0] else None) for source in self.sources]

    def _splits_of(self, objects: Sequence[Object]) -> dict[str, str]:
        """Draw the split of each object whose source states none, by seed and id; each category is spread evenly over the splits."""
        stated_splits = {item.object_id: item.split for item in objects if item.split}
        items = [item for item in objects if not item.split]
        amounts = (self.splits.train, self.splits.valid, self.splits.test)
        if self.splits.are_counts and sum(amounts) != len(items):
            counts = " + ".join(f"{number:g}" for number in amounts)
            raise InvalidInput(
                f"the splits count {counts} = {sum(amounts):g} objects, the sources list {len(items)}"
                f"{f' without the {len(stated_splits)} whose source states its split' if stated_splits else ''}; "
                "complete the folder, or state shares that sum to 1 in a manifest of your own"
            )
        lots = {item.object_id: hashlib.sha256(f"{self.seed}\0split\0{item.object_id}".encode()).hexdigest() for item in items}
        shuffled = sorted(items, key=lambda item: lots[item.object_id])
        sizes, ranks = Counter(item.category for item in items), defaultdict[str, Iterator[int]](count)
        shares = {item.object_id: (next(ranks[item.category]) + 0.5) / sizes[item.category] for item in shuffled}
        order = sorted(shares, key=lambda object_id: (shares[object_id], lots[object_id]))
        split_sizes = [round(number) for number in amounts] if self.splits.are_counts else _sizes(amounts, len(items))
        names = [split for split, size in zip(SPLITS, split_sizes, strict=True) for _ in range(size)]
        return stated_splits | dict(zip(order, names, strict=True))


def _sizes(shares: Sequence[float], objects: int) -> list[int]:
    """Round shares of some objects to whole numbers; a split left empty gets one of the largest, if that has two."""
    ends = [0, round(shares[0] * objects), round((shares[0] + shares[1]) * objects), objects]
    sizes = [last - first for first, last in pairwise(ends)]
    for split, share in enumerate(shares):
        if share > 0 and sizes[split] == 0 and max(sizes) > 1:
            sizes[sizes.index(max(sizes))] -= 1
            sizes[split] = 1
    return sizes


def _check_names(objects: Sequence[Object]) -> None:
    for item in objects:
        if not OBJECT_ID.fullmatch(item.object_id):
            rule = "up to 120 letters, digits, '.', '_', '-' can, the first no '.', and not zarr.json: rename it, or its file"
            raise InvalidInput(f"{item.object_id!r} cannot name an object; {rule}")
        without_controls(item.category)
        if not item.category.strip():
            raise InvalidInput(f"{item.object_id} has no category; name one: an empty one has no name in tables")
        if item.category == TOTAL:
            raise InvalidInput(f"{item.object_id} is of category {TOTAL!r}, as tables call the total; rename its folder, or its category")
    for one, other in pairwise(objects):
        if one.object_id == other.object_id:
            origins = " and ".join(str(item.source.get("file", "a procedural one")) for item in (one, other))
            raise InvalidInput(f"two objects are called {one.object_id}: {origins}; rename a file, or let one procedural source make both")


def load_manifest(name_or_path: str) -> Manifest:
    """Read a manifest: one of the built-in names, or the path of a YAML file; raise an `InvalidInput` if it is invalid.

    A relative `path` of a file's source counts from the file's folder, of a built-in manifest from where the command runs.
    """
    file = description_path("manifest", name_or_path)
    manifest = read_description("manifest", file, Manifest, *MESH_SOURCES.values())
    if str(name_or_path) in shipped_files("manifest"):
        return manifest
    return manifest._with(FolderSource, lambda source: {"path": source.path and file.parent / expanded(source.path)})
