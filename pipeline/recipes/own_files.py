"""Collect the user's own hand, sensor and scene files, and the files that these name, for a recipe.

They keep their relative paths, so that references between them stay valid. A recipe contains small text files, and the
SHA-256 of others.
"""

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pipeline.console import NAMED, pluralise
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import Kind, description_path, read_yaml, shipped_files, texts_in
from pipeline.formats.file_content import read_file
from pipeline.formats.hand_file import load_hand
from pipeline.formats.mesh_companions import MAX_BYTES, Companions
from pipeline.formats.sensor_file import sensor_files, sensor_names
from pipeline.formats.urdf import parse_urdf
from pipeline.formats.urdf_shapes import mesh_path
from pipeline.recipes.recipe import MAX_TEXTS, TEXT_SUFFIXES, Recipe, check_file_name
from pipeline.store.atomic import refuse_links, write_atomically

DESCRIBED: Mapping[str, Kind] = {"hand": "hand", "sensor": "sensor", "sensors": "sensor", "scene": "scene"}
"""Settings that name description files, and the kind of each."""

MAX_TEXT = 2**16
"""Bytes of a text file that a recipe holds; the hand file of the Allegro has 2 kB, its URDF 16 kB."""


def own_names(settings: Mapping[str, Any]) -> Iterator[tuple[Kind, str]]:
    """List the description files of a stage's settings that come with no package, as they are named."""
    for setting, kind in DESCRIBED.items():
        value = settings.get(setting)
        for name in value if isinstance(value, list | tuple) else [value]:
            if name is not None and name not in shipped_files(kind):
                yield kind, name


def with_names(settings: Mapping[str, Any], rename: Callable[[str, Any], Any]) -> dict[str, Any]:
    """Change the names of description files in a stage's settings: `rename` gets a setting, and the name or each name of its list."""
    changed = dict(settings)
    for setting in DESCRIBED.keys() & settings.keys():
        value = settings[setting]
        changed[setting] = [rename(setting, name) for name in value] if isinstance(value, list) else rename(setting, value)
    return changed


def own_path(kind: Kind, name: str) -> Path:
    """Find a description file of the user's own, links followed, as hand files are read."""
    return description_path(kind, name).resolve()


def find_files(settings: Iterable[Mapping[str, Any]]) -> dict[str, Path]:
    """Find the files of the user's own that stages with these settings read, by their paths below the folder that holds all of them."""
    paths = {path.resolve() for values in settings for kind, name in own_names(values) for path in _files(kind, name, values)}
    if not paths:
        return {}
    root = os.path.commonpath([path.parent for path in paths])
    names = {path.relative_to(root).as_posix(): path for path in sorted(paths)}
    for name, path in names.items():
        try:
            check_file_name(name)
        except ValueError as error:
            raise InvalidInput(f"{path} cannot be published: {error}; rename it, then run the stages again") from error
    return names


def _files(kind: Kind, name: str, settings: Mapping[str, Any]) -> Iterator[Path]:
    if kind == "sensor":
        yield from sensor_files([name])
        return
    yield own_path(kind, name)
    if kind == "hand":
        hand = load_hand(name)
        files = [file.resolve() for file in hand.files[1:]]
        yield from files
        for path in files:  # each in a package, of which this is the mark
            yield from [file for folder in path.parents if (file := folder / "package.xml").is_file()][:1]
        if "sensor" in settings and settings["sensor"] is None:
            yield from sensor_files([sensor for sensor in sensor_names(hand) if sensor not in shipped_files("sensor")])


def read_files(files: Mapping[str, Path]) -> tuple[dict[str, str], dict[str, str]]:
    """Read the files that a recipe carries: the texts of some, the SHA-256 of the others.

    An `InvalidInput` names a file that cannot be read, or whose references would break elsewhere.
    """
    texts, digests = dict[str, str](), dict[str, str]()
    for name, path in files.items():
        if outside := next(_outside(path, Path(name).parts), None):
            raise InvalidInput(f"{path} names {outside!r}: write it relative to this file; then run the stages again")
        content = read_file(path, MAX_BYTES)
        if len(content) <= MAX_TEXT and name.endswith(TEXT_SUFFIXES) and len(texts) < MAX_TEXTS:
            with suppress(UnicodeDecodeError):
                texts[name] = content.decode()
        if name not in texts:
            digests[name] = hashlib.sha256(content).hexdigest()
    return texts, digests


def place_files(recipe: Recipe, folder: Path) -> None:
    """Check the files of a recipe in a folder, then write its texts that are missing there.

    An `InvalidInput` names a file that is missing or differs, or that names one outside the folder.
    """
    digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in recipe.texts.items()} | recipe.files
    faults = []
    for name, expected in digests.items():
        if not os.path.lexists(folder / name):
            if name in recipe.files:
                faults.append(f"{folder / name} is missing, its SHA-256 is {expected}")
        elif (actual := hashlib.sha256(read_file(folder / name, MAX_BYTES)).hexdigest()) != expected:
            faults.append(f"{folder / name} has SHA-256 {actual}, the recipe says {expected}")
    if faults:
        where = f"download them from {recipe.files_url}" if recipe.files_url else "ask who published the recipe for them"
        raise InvalidInput(
            f"{pluralise(len(faults), 'hand, sensor or scene file')} to restore: {'; '.join(faults[:NAMED])}"
            f"{'; …' if len(faults) > NAMED else ''}. {where[0].upper()}{where[1:]}"
        )
    refuse_links(folder, recipe.texts)
    for name, text in recipe.texts.items():
        if not os.path.lexists(folder / name):
            try:
                write_atomically(folder / name, text.encode())
            except OSError as error:
                raise InvalidInput(f"{folder / name} cannot be written ({error.strerror}); name another folder: --descriptions") from error
    for name in digests:
        if outside := next(_outside(folder / name, Path(name).parts), None):
            raise InvalidInput(f"the recipe's {name} names {outside!r}, which may lie outside the folder of its files; do not use it")


def _outside(file: Path, parts: tuple[str, ...]) -> Iterator[str]:
    """List paths in a file that lie outside the folder `len(parts)` levels above it: a reader of the YAML could open them."""
    try:
        content = read_yaml(file)
    except (InvalidInput, RecursionError):
        return
    if not isinstance(content, dict):
        return
    folder = "/".join(parts[:-1])
    for text in texts_in(content):
        if text.startswith(("/", "~")) or os.path.normpath(f"{folder or '.'}/{text}").split("/")[0] == "..":
            yield text
    urdf = content.get("urdf")
    if isinstance(urdf, str) and os.path.isfile(file.parent / urdf):
        yield from _meshes_outside(file.parent / urdf, file.parents[len(parts) - 1].resolve())


def _meshes_outside(urdf: Path, root: Path) -> Iterator[str]:
    """List a URDF's meshes and their textures that lie outside a folder; files that its reader refuses to open are skipped."""
    with suppress(InvalidInput):
        for mesh in parse_urdf(urdf).iter("mesh"):
            name = mesh.get("filename", "")
            with suppress(InvalidInput, OSError):
                path, package = mesh_path(name, urdf.parent)
                if not path.resolve().is_relative_to(root):
                    yield name
                else:
                    beside = Companions(path, package).paths
                    yield from (named for named, file in beside.items() if not file.is_relative_to(root))
