"""Folders of mesh files as sources: any folder, one with a catalogue, one laid out as ShapeNetCore is."""

import csv
import hashlib
import io
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, model_validator

from pipeline.config.sources import MeshSource, Object
from pipeline.console import abbreviate, pluralise
from pipeline.errors import InvalidInput
from pipeline.formats.file_content import MESH_SUFFIXES, expanded, read_text
from pipeline.formats.file_units import GREATEST_UNIT, LEAST_UNIT

MAX_ENTRIES = 500_000  # most files and folders below a folder of meshes: with more, it is probably the wrong folder
MAX_CATALOGUE_BYTES = 100 * 2**20  # largest size of a catalogue: 500 bytes for each of `MAX_OBJECTS`
UNREAD = (".msh", ".3ds", ".fbx", ".blend", ".max", ".x3d", ".wrl", ".step", ".stp", ".iges", ".igs", ".skp", ".usd", ".usdz")
"""Formats of meshes and solids that are not read."""
Layout = Literal["files", "folders"]
SCANS = ("google_16k", "google_64k", "google_512k", "poisson", "tsdf")  # folders of the YCB objects' scans, best first
COLLISION = {"collision", "collisions", "convex", "coacd", "vhacd", "decomposition"}  # folders of simplified shapes
INNER = {"mesh", "meshes", "model", "models", "visual", "visuals", "obj", "textured", "nontextured", *SCANS, *COLLISION}
"""Folders inside that of an object."""
PLAIN = {"nontextured", "untextured"}
GENERIC = {"model", "mesh", "object", "textured", "textured_simple", "textured_mesh", "model_normalized", "base", "visual", "scan", *PLAIN}
"""File names that do not name an object."""


class MeshFile(NamedTuple):
    """A mesh file that is an object."""

    file: Path  # below the folder of meshes
    name: str
    category: str | None  # None if no folder names one


class FolderSource(MeshSource):
    """A source that is a folder of mesh files."""

    path: Path | None = Field(None, description="The folder; by default, the one given with `--objects`.")

    def folder(self, root: Path | None, description: str) -> Path:
        """Return the folder, or `root` instead of it; the message of a missing one asks for what is described."""
        path = root or self.path
        path = path and expanded(path)
        if path is None or not path.is_dir():
            problem = "the manifest names no folder" if path is None else f"{path.resolve()} is no folder"
            raise InvalidInput(f"{problem}; give {description} with --objects DIR (make: OBJECTS=DIR)")
        return path


class Directory(FolderSource):
    """Any folder of mesh files, each an object, or with a folder per object; a sub-folder above is its category.

    ```yaml
    - {kind: directory, licence: CC0, path: ~/meshes, metres_per_unit: 0.001, up: y}
    ```
    """

    kind: Literal["directory"]
    layout: Layout | None = Field(
        None,
        description="files: each mesh file is an object; folders: each folder is one, even with several meshes; by default what "
        "most folders look like.",
    )
    category: str = Field("object", description="Of objects without a sub-folder above.")

    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List every mesh file below the folder, except hidden ones."""
        folder, _, objects, _ = self._listing(root)
        for item in objects:
            yield Object(item.name, item.category or self.category, self.describe(folder / item.file, folder))

    def remarks(self, root: Path | None) -> Iterator[str]:
        """Name a layout that was recognised, other meshes of one object, formats that are not read, and links, which are not followed."""
        folder, entries, _, remarks = self._listing(root)
        yield from remarks
        files_by_reason = defaultdict[str, list[str]](list)
        for path in entries:
            if path.is_symlink() and path.is_dir():
                files_by_reason["links to folders are not followed; copy what they lead to"].append(str(path.relative_to(folder)))
            elif (suffix := path.suffix.lower()) in UNREAD:
                reason = f"{suffix} cannot be read; convert to one of {', '.join(MESH_SUFFIXES)}"
                files_by_reason[reason].append(str(path.relative_to(folder)))
        for reason, files in files_by_reason.items():
            yield f"skipped {pluralise(len(files), 'file')} ({abbreviate(files)}): {reason}"

    def _listing(self, root: Path | None) -> tuple[Path, list[Path], list[MeshFile], list[str]]:
        """List the folder, everything below it, the objects, and what `find_objects` says of them."""
        folder = self.folder(root, "a folder of meshes")
        entries = sorted(islice(folder.rglob("*"), MAX_ENTRIES + 1))
        if len(entries) > MAX_ENTRIES:
            raise InvalidInput(f"{folder.resolve()} has more than {MAX_ENTRIES} files and folders; give the folder of the meshes alone")
        relative = [path.relative_to(folder) for path in entries if path.suffix.lower() in MESH_SUFFIXES and not path.is_dir()]
        files = [file for file in relative if not any(part.startswith(".") for part in file.parts)]
        if not files:
            raise InvalidInput(f"no mesh files below {folder.resolve()}; looked for {', '.join(MESH_SUFFIXES)} in all its sub-folders")
        return folder, entries, *find_objects(files, self.layout)


class Catalogue(FolderSource):
    """A folder whose `catalogue.csv` lists mesh files below it, one per line.

    Its columns are `object_id`, `category`, `file`, `up`, optionally `metres_per_unit` (these two the source's where they are empty), and
    whatever else its readers want to know of an object, such as `licence` and `creator`.

    ```yaml
    - {kind: catalogue, licence: see catalogue.csv, path: ~/furniture, up: y}
    ```
    """

    kind: Literal["catalogue"]
    objects: tuple[str, ...] | None = Field(None, description="Ids of those that are taken; by default, all.")

    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List the objects of the catalogue in its order; one whose file is missing fails when it is read."""
        items = [*self._listed(root)]
        if self.objects is not None and (missing := sorted({*self.objects} - {item.object_id for item in items})):
            raise InvalidInput(f"the catalogue lists no {abbreviate(missing)}; correct `objects` of the source, or complete the catalogue")
        yield from (item for item in items if self.objects is None or item.object_id in self.objects)

    def _listed(self, root: Path | None) -> Iterator[Object]:
        folder = self.folder(root, "a folder with a catalogue.csv (`make household` fills data/meshes/household)")
        file = folder / "catalogue.csv"
        try:
            lines = csv.DictReader(io.StringIO(read_text(file, MAX_CATALOGUE_BYTES), newline=""), restval="")
            if missing := [name for name in ("object_id", "category", "file", "up") if name not in (lines.fieldnames or ())]:
                raise InvalidInput(f"{file.resolve()} has no column {', '.join(missing)}; its first line names the columns")
            for line in lines:
                where, path, stated = f"{file.resolve()}: {line['object_id']}", Path(line["file"]), line.get("metres_per_unit")
                if line["up"] not in ("", "x", "y", "z"):
                    raise InvalidInput(f"{where} has up {line['up']!r}; it must be x, y, z or empty")
                if path.is_absolute() or ".." in path.parts:
                    raise InvalidInput(f"{where} has file {line['file']!r}; it must be a path below {folder.resolve()}")
                unit = _number(stated) if stated else None
                if unit is not None and not LEAST_UNIT <= unit <= GREATEST_UNIT:
                    bounds = f"from {LEAST_UNIT:g} to {GREATEST_UNIT:g}"
                    raise InvalidInput(f"{where} has metres_per_unit {stated!r}; it must be a number {bounds}, 0.001 for mm, or empty")
                yield Object(line["object_id"], as_name(line["category"]), self.describe(folder / path, folder, line["up"], unit))
        except csv.Error as error:
            raise InvalidInput(f"{file.resolve()} cannot be read as CSV: {error}") from error


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


class ShapeNet(FolderSource):
    """A folder laid out as ShapeNetCore is: SYNSET/MODEL/models/model_normalized.obj, or SYNSET/MODEL/model.obj.

    Renderings, where a manifest names their folder, lie in SYNSET/MODEL/rendering below it.

    ```yaml
    - {kind: shapenet, licence: ShapeNet terms of use, path: ~/ShapeNetCore.v2, up: y, synsets: {bottle: "02876657", knife: "03624134"}}
    ```
    """

    kind: Literal["shapenet"]
    meshes: str = Field(".", description="Folder of the synsets, from the folder given.")
    renderings: str | None = Field(None, description="Folder of the renderings' synsets, from the folder given.")
    classes_may_be_missing: bool = Field(False, description="Whether a synset without a folder is skipped.")
    synsets: dict[str, Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+$")]] = Field(min_length=1, description="Synset of each category.")
    counts: dict[str, int] | None = Field(None, description="How many models each category must have; by default, any number.")

    @model_validator(mode="after")
    def _counts_are_of_the_synsets(self) -> "ShapeNet":
        if self.counts is not None and self.counts.keys() != self.synsets.keys():
            raise ValueError(f"counts are of {sorted(self.counts)}, synsets of {sorted(self.synsets)}; they must be the same")
        return self

    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List every model of the named synsets, whose numbers must be those of `counts`; one without a file fails when it is read."""
        parent = self.folder(root, "a folder laid out as ShapeNetCore")
        folder = parent / self.meshes
        present = {category: synset for category, synset in self.synsets.items() if (folder / synset).is_dir()}
        if not present:
            problem = f"has none of {abbreviate([*self.synsets.values()])}" if folder.is_dir() else "is no folder"
            layout = Path("DIR", self.meshes, "SYNSET", "MODEL", "model.obj")
            raise InvalidInput(f"{folder.resolve()} {problem}; give a folder laid out as {layout} with --objects DIR (make: OBJECTS=DIR)")
        for category, synset in (present if self.classes_may_be_missing else self.synsets).items():
            models = [model for model in sorted((folder / synset).glob("*")) if model.is_dir()]
            files = {model.name: model / "models" / "model_normalized.obj" for model in models}
            shorter = {model.name: model / "model.obj" for model in models if not files[model.name].is_file()}
            files |= {name: file for name, file in shorter.items() if file.is_file()}
            complete = sum(file.is_file() for file in files.values())
            where = (folder / synset).resolve()
            if not complete:
                raise InvalidInput(f"no models of {category} in {where}; looked for MODEL/models/model_normalized.obj and MODEL/model.obj")
            if self.counts is not None and complete != self.counts[category]:
                raise InvalidInput(
                    f"{where} holds {complete} models of {category}, the manifest counts {self.counts[category]}; "
                    "complete or prune the folder, or state other counts in a manifest of your own"
                )
            for name, file in files.items():
                # its materials name ../images
                source = self.describe(file, folder / synset / name)
                if self.renderings is not None:
                    source["renderings"] = str(parent / self.renderings / synset / name / "rendering")
                yield Object(f"{category}-{as_name(name)}", category, source)


def find_objects(
    files: Sequence[Path],  # sorted, below the folder of meshes
    layout: Layout | None = None,
) -> tuple[list[MeshFile], list[str]]:
    """Find the objects among mesh files, and say what was recognised and what is skipped.

    With layout "files", each is an object, whose category is the top folder. With "folders", each folder is an object,
    whose category is the top folder if there is one above it. The default is "folders" where most folders hold meshes
    of one object, else "files".

    An object's folder is the nearest folder above a mesh that has no name of `INNER`. It holds meshes of one object if
    all of them but those for collisions have one name, apart from `GENERIC` ones.
    """
    homes = defaultdict[tuple[str, ...], list[Path]](list)
    for file in files:
        homes[_home(file)].append(file)
    loose = homes.pop((), [])
    single = {home for home, meshes in homes.items() if layout == "folders" or (layout is None and len(_names(meshes)) < 2)}
    if layout is None and len(single) <= len(homes) / 2:
        single = set()
    elif layout is None and len(single) == 1:  # one object, if its file is called as the folder, or anything
        home = next(iter(homes))
        single = single if _names(homes[home]) <= {home[-1].lower()} else set()
    objects, others = [_by_file(file) for file in loose], []
    for home, meshes in homes.items():
        if home in single:
            best = min(meshes, key=_rank)
            objects.append(MeshFile(best, as_name(*home), as_name(home[0]) if len(home) > 1 else None))
            others += [file for file in meshes if file is not best]
        else:
            objects += [_by_file(file) for file in meshes]
    repeated = Counter(item.name for item in objects)
    objects = [item if repeated[item.name] == 1 else item._replace(name=f"{item.name}-{item.file.suffix[1:].lower()}") for item in objects]
    remarks = list[str]()
    if single:
        example = next(item for item in objects if item.file.parent.parts)
        remarks.append(
            f"a folder per object: {pluralise(len(single))}, such as {example.name} from {example.file.as_posix()} (`layout: files` in a "
            "manifest of your own makes an object of each file)"
        )
    if others:
        names = [file.as_posix() for file in sorted(others)]
        remarks.append(f"skipped {pluralise(len(names), 'file')} ({abbreviate(names)}): another mesh of the same object is taken")
    return objects, remarks


def as_name(*parts: str) -> str:
    """Write parts of a path as an object id: joined by dashes, other characters replaced; a part that is not ASCII gets its hash."""
    hashes = ("" if part.isascii() else f"-{hashlib.sha256(os.fsencode(part)).hexdigest()[:8]}" for part in parts)
    return "-".join(re.sub(r"[^A-Za-z0-9._-]+", "_", part) + digest for part, digest in zip(parts, hashes, strict=True))


def _by_file(file: Path) -> MeshFile:
    return MeshFile(file, as_name(*file.with_suffix("").parts), as_name(file.parts[0]) if len(file.parts) > 1 else None)


def _home(file: Path) -> tuple[str, ...]:
    parts = file.parent.parts
    while parts and parts[-1].lower() in INNER:
        parts = parts[:-1]
    return parts


def _names(files: Sequence[Path]) -> set[str]:
    """Collect the names of files, without those for collisions unless there are no others."""
    visible = [file for file in files if not _collides(file)] or files
    return {file.stem.lower() for file in visible} - GENERIC


def _collides(file: Path) -> bool:
    return any(part.lower() in COLLISION for part in file.parent.parts) or any(word in file.stem.lower() for word in COLLISION)


def _rank(file: Path) -> tuple[object, ...]:
    """Rank a mesh among those of one object: visual, with textures, of the better scan, of a format with materials; then by path."""
    folders = {part.lower() for part in file.parent.parts}
    scan = next((number for number, name in enumerate(SCANS, 1) if name in folders), 0)
    plain = file.stem.lower() in PLAIN or bool(folders & PLAIN)
    suffixes = (".obj", ".glb", ".gltf", ".dae", *MESH_SUFFIXES)
    return _collides(file), plain, scan, suffixes.index(file.suffix.lower()), len(file.parts), file.as_posix()
