"""The files that a mesh file names: an OBJ's materials and their textures, a glTF's buffers and images, a PLY's texture.

The key of a mesh covers them, and its reader may open no others.
"""

import hashlib
import html
import os
import re
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cached_property, lru_cache
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import MESH_SUFFIXES, decode_text, read_file, refuse_foreign, without_mark
from pipeline.formats.gltf import file_names, read_document
from pipeline.formats.obj_materials import OPTIONS, Material, read_library

MAX_BYTES = 256 * 2**20  # maximum size of a mesh file, and of all files that it names together
MAX_NAMES = 1000  # maximum number of file names in a mesh file
WIDE_SOLID = re.compile(rb"(\xff\xfe|(\0\0)?\xfe\xff)\0*s\0+o\0+l\0+i\0+d", re.IGNORECASE)  # how an STL of text begins in UTF-16 and -32
LIBRARY = re.compile(rb"(?:^|\r)[ \t]*mtllib[ \t]+([^\r\n]*)", re.MULTILINE | re.IGNORECASE)  # a line of an OBJ that names materials
IMAGE = re.compile(rb"<image\b[^>]*>(?:(?!</?image\b).)*?<init_from>([^<]*)</init_from>", re.DOTALL)
"""An image of a COLLADA file, with its file. Surfaces contain `init_from` too, but with the id of an image."""
SEARCHED_SUFFIXES = {".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tga", ".tif", ".tiff", ".webp", ".dds", ".ppm", ".pcx"}
"""Suffixes of files that are searched for. A glTF's buffer is not: another one would be another shape."""
MAX_ENTRIES = 200_000  # maximum number of files and folders below a folder that is searched; a larger one is not searched
CACHE_SECONDS = 60  # how long a listing is used: thousands of meshes may lack their textures


class Companions(Mapping[str, bytes]):
    """The contents of the files that a mesh file names, by the name it gives them; each is read once.

    Only regular files below the root, by default the mesh file's folder, are included; a symbolic link counts as its target. Names are
    relative to the mesh file. `unread` lists the others, and whatever else its reader cannot read, each with the reason. `content` is
    that of the mesh file, text without a byte-order mark.
    """

    def __init__(self, file: Path, root: Path | None = None) -> None:
        self.file_name = file.name
        self._folder, self._root = file.parent, (root or file.parent).resolve()
        self._contents: dict[Path, bytes] = {}
        self._stored = read_file(file, MAX_BYTES, file.name)
        if not self._stored:
            raise InvalidInput(f"{file.name} is an empty file")
        self.content = self._stored if _is_binary_stl(file, self._stored) else without_mark(file.name, self._stored)
        self.paths: dict[str, Path] = {}
        self.unread: list[str] = []
        self.materials: dict[str, list[Material]] = {}  # of an OBJ's libraries
        names = set[str]()
        for name in self._names(file, self.content):  # lazily: a file full of names would fill the memory
            if name in names:
                continue
            names.add(name)
            if len(names) > MAX_NAMES:
                raise InvalidInput(f"{file.name} names more than {MAX_NAMES} files; merge its materials")
            if path := self._find(name):
                self.paths[name] = path
                if (size := sum(path.stat().st_size for path in set(self.paths.values()))) > MAX_BYTES:
                    limit = f"{MAX_BYTES} are the most; make its textures smaller"
                    raise InvalidInput(f"{file.name} names files of {size} bytes in all, {limit}")
            elif name:
                self.unread.append(f"{name} is missing below the folder of meshes")

    def __getitem__(self, name: str) -> bytes:
        path = self.paths[name]
        if path not in self._contents:
            self._contents[path] = path.read_bytes()
        return self._contents[path]

    def __iter__(self) -> Iterator[str]:
        return iter(self.paths)

    def __len__(self) -> int:
        return len(self.paths)

    @cached_property
    def sha256(self) -> str:
        """The SHA-256 of the mesh file."""
        return hashlib.sha256(self._stored).hexdigest()

    def _names(self, file: Path, content: bytes) -> Iterator[str]:
        match file.suffix.lower():
            case ".gltf" | ".glb":
                refuse_foreign(file.name, content)
                yield from file_names(read_document(file.name, content))
            case ".dae":
                yield from (html.unescape(_decode(name)) for name in IMAGE.findall(content))
            case ".ply":
                yield from texture_names(content.partition(b"end_header")[0])
            case ".obj":
                libraries = set[str]()
                for line in LIBRARY.finditer(content):
                    name = _decode(line[1])
                    for library in [name] if self._find(name) else name.split():  # a name may have blanks, a line several names
                        yield library
                        if library in self.paths and library not in libraries:
                            libraries.add(library)
                            yield from read_library(library, self[library], self.materials, self.unread)

    def _find(self, name: str) -> Path | None:
        """Find a file by its name as it is, without percent signs, below the root, beside the mesh file, or elsewhere below the root."""
        plain = unquote(name).replace("\\", "/")
        for candidate in (name, plain, name.lstrip("/"), plain.rpartition("/")[2]):
            if path := self._regular(self._folder / candidate):
                return path
        if elsewhere := find_below(self._root, self._folder.resolve(), plain):
            return self._regular(elsewhere)
        return self._find(plain[match.end() :]) if (match := OPTIONS.match(plain)) else None

    def _regular(self, path: Path) -> Path | None:
        try:
            resolved = path.resolve()
            return resolved if resolved.is_relative_to(self._root) and resolved.is_file() else None
        except (OSError, ValueError, RuntimeError):  # too long, a zero byte, a link to itself
            return None


def _is_binary_stl(file: Path, content: bytes) -> bool:
    """Check whether a file is a binary STL, whose first 80 bytes may be anything."""
    return (
        file.suffix.lower() == ".stl"
        and not WIDE_SOLID.match(content)
        and len(content) >= 84 + 50 * int.from_bytes(content[80:84], "little")
    )


def texture_names(header: bytes) -> Iterator[str]:
    """List the names of textures that the comments of a PLY file state."""
    for line in header.splitlines():
        if (start := line.lower().find(b"texturefile")) >= 0:
            yield _decode(line[start + len(b"texturefile") :])


def _decode(name: bytes) -> str:
    return decode_text(name).strip()


def find_below(
    root: Path,
    folder: Path,  # of the mesh file
    name: str,  # between slashes, as the mesh file states it
) -> Path | None:
    """Find a file below a folder that a mesh file below it names by another path: the nearest one of this name, upper or lower case.

    That is, of those with the deepest folder in common with the mesh, the one whose path has the longest end in common with the stated
    one. None if two are equally near, or if its folder holds other meshes: it is theirs.
    """
    stated_parts = [part for part in name.lower().split("/") if part not in ("", ".", "..")]
    if not stated_parts or Path(stated_parts[-1]).suffix not in SEARCHED_SUFFIXES or not folder.is_relative_to(root):
        return None
    listing, mesh_parts = _list(root, int(time.monotonic() // CACHE_SECONDS)), folder.relative_to(root).parts
    ranked = []
    for parts in listing.files.get(stated_parts[-1], ()):
        shared = _common(parts[:-1], mesh_parts)
        branch = parts[: shared + 1]
        if len(branch) == len(parts) or branch not in listing.with_meshes:
            ranked.append(((shared, _common([part.lower() for part in reversed(parts)], stated_parts[::-1])), parts))
    best = max((rank for rank, _ in ranked), default=None)
    nearest = [parts for rank, parts in ranked if rank == best]
    return root.joinpath(*nearest[0]) if len(nearest) == 1 else None


class _Listing(NamedTuple):
    """Files by their names in lower case, and the folders with meshes at any depth, as the parts of their paths."""

    files: dict[str, list[tuple[str, ...]]]
    with_meshes: set[tuple[str, ...]]


@lru_cache(maxsize=2)
def _list(root: Path, period: int) -> _Listing:
    files, with_meshes, entries = defaultdict[str, list[tuple[str, ...]]](list), set[tuple[str, ...]](), 0
    for directory, folders, names in os.walk(root):
        entries += len(folders) + len(names)
        if entries > MAX_ENTRIES:
            return _Listing({}, set())
        parts = Path(directory).relative_to(root).parts
        for name in names:
            suffix = os.path.splitext(name)[1].lower()
            if suffix in SEARCHED_SUFFIXES:
                files[name.lower()].append((*parts, name))
            elif suffix in MESH_SUFFIXES:
                with_meshes.update(parts[:depth] for depth in range(1, len(parts) + 1))
    return _Listing(dict(files), with_meshes)


def _common(one: tuple[str, ...] | list[str], other: tuple[str, ...] | list[str]) -> int:
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
