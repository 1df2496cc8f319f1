"""The layout of a folder of meshes: each file is an object, or each folder, which may hold several meshes of one object."""

import hashlib
import os
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from pipeline.console import abbreviate, pluralise
from pipeline.formats.file_content import MESH_SUFFIXES

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
