"""Find textures and materials that are not where mesh files say, but elsewhere below the folder of meshes."""

from __future__ import annotations

import os
import time
from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from itertools import takewhile
from pathlib import Path

from pipeline.formats.file_content import MESH_SUFFIXES

SEARCHED_SUFFIXES = {".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tga", ".tif", ".tiff", ".webp", ".dds", ".ppm", ".pcx"}
"""Suffixes of files that are searched for. A glTF's buffer is not: another one would be another shape."""

MAX_ENTRIES = 200_000
"""Maximum number of files and folders below a folder that is searched; in a larger one nothing is found."""

CACHE_SECONDS = 60
"""How long a listing is used: thousands of meshes may lack their textures."""


def find_below(root: Path, folder: Path, name: str) -> Path | None:
    """Find a file that is not where a mesh file says.

    Parameters
    ----------
    root
        The folder to look in.
    folder
        The mesh file's folder, below the root.
    name
        The path that the mesh file states, between slashes.

    Returns
    -------
    The file of this name, upper or lower case, that is nearest to the mesh: of those with the deepest folder in common, the one whose path
    has the longest end in common with the stated one. None if two are equally near, or if its folder holds other meshes: it is theirs.
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


@dataclass(frozen=True)
class _Listing:
    """Files by their names in lower case, and the folders with meshes at any depth, as the parts of their paths."""

    files: dict[str, list[tuple[str, ...]]]
    with_meshes: set[tuple[str, ...]]


@lru_cache(maxsize=2)
def _list(root: Path, period: int) -> _Listing:
    """List the files below a folder, without following links to folders."""
    files, with_meshes, entries = defaultdict[str, list[tuple[str, ...]]](list), set[tuple[str, ...]](), 0
    for place, folders, names in os.walk(root):
        entries += len(folders) + len(names)
        if entries > MAX_ENTRIES:
            return _Listing({}, set())
        parts = Path(place).relative_to(root).parts
        for name in names:
            suffix = os.path.splitext(name)[1].lower()
            if suffix in SEARCHED_SUFFIXES:
                files[name.lower()].append((*parts, name))
            elif suffix in MESH_SUFFIXES:
                with_meshes.update(parts[:depth] for depth in range(1, len(parts) + 1))
    return _Listing(dict(files), with_meshes)


def _common(one: tuple[str, ...] | list[str], other: tuple[str, ...] | list[str]) -> int:
    """Count the equal parts at the beginning."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
