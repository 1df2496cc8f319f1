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
from pipeline.formats.mesh_companions import MAX_BYTES
from pipeline.formats.sensor_file import sensor_files, sensor_names
from pipeline.recipes.recipe import MAX_TEXTS, TEXT_SUFFIXES, Recipe, check_file_name
from pipeline.store.atomic import refuse_links, write_atomically

DESCRIBED: Mapping[str, Kind] = {"hand": "hand", "sensor": "sensor", "sensors": "sensor", "scene": "scene"}
"""Settings that name description files, and the kind of each."""

MAX_TEXT = 2**16  # bytes of a text file that a recipe holds; the hand file of the Allegro has 2 kB, its URDF 16 kB


def own_names(settings: Mapping[str, Any]) -> Iterator[tuple[Kind, str]]:
    """List the description files of a stage's settings that come with no package, as they are named."""
    for setting, kind in DESCRIBED.items():
        value = settings.get(setting)
        for name in value if isinstance(value, list | tuple) else [value]:
            if isinstance(name, str) and name not in shipped_files(kind):
                yield kind, name


def with_names(settings: Mapping[str, Any], rename: Callable[[str, Any], Any]) -> dict[str, Any]:
    """Change the names of description files in a stage's settings: `rename` gets a setting, and the name or each name of its list."""
    changed = dict(settings)
    for setting in DESCRIBED.keys() & settings.keys():
        value = settings[setting]
        changed[setting] = [rename(setting, name) for name in value] if isinstance(value, list) else rename(setting, value)
    return changed


def find_files(settings: Iterable[Mapping[str, Any]]) -> dict[str, Path]:
    """Find the files of the user's own that stages with these settings read, by their paths below the folder that holds all of them."""
    paths = {path.resolve() for values in settings for kind, name in own_names(values) for path in _files(kind, name)}
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


def _files(kind: Kind, name: str) -> Iterator[Path]:
    if kind == "sensor":
        yield from sensor_files([name])
    elif kind == "scene":
        yield description_path(kind, name)
    else:
        hand = load_hand(name)
        yield from hand.files
        for path in hand.files[1:]:  # each in a package, of which this is the mark
            yield from [file for folder in path.resolve().parents if (file := folder / "package.xml").is_file()][:1]
        yield from sensor_files([sensor for sensor in sensor_names(hand) if sensor not in shipped_files("sensor")])


def read_files(files: Mapping[str, Path]) -> tuple[dict[str, str], dict[str, str]]:
    """Read the files that a recipe carries: the texts of some, the SHA-256 of the others."""
    texts, digests = dict[str, str](), dict[str, str]()
    for name, path in files.items():
        if outside := _names_outside(path, name):
            raise InvalidInput(f"{path} names {outside[0]!r}: write it relative to this file; then run the stages again")
        content = read_file(path, MAX_BYTES)
        if len(content) <= MAX_TEXT and name.endswith(TEXT_SUFFIXES) and len(texts) < MAX_TEXTS:
            with suppress(UnicodeDecodeError):
                texts[name] = content.decode()
        if name not in texts:
            digests[name] = hashlib.sha256(content).hexdigest()
    return texts, digests


def place_files(recipe: Recipe, folder: Path) -> None:
    """Check the files of a recipe in a folder, then write its texts that are missing there."""
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
    hands = {name for stage in recipe.stages.values() for kind, name in own_names(stage.settings) if kind == "hand" and name in digests}
    for name in digests:
        outside = _names_outside(folder / name, name)
        if name in hands and not outside:
            with suppress(InvalidInput):  # one that cannot be used is named when the settings are checked
                outside = [str(file) for file in load_hand(folder / name).files if not file.resolve().is_relative_to(folder.resolve())]
        if outside:
            raise InvalidInput(f"the recipe's {name} names {outside[0]!r}, which may lie outside the folder of its files; do not use it")


def _names_outside(
    file: Path,
    name: str,  # its path below the folder of a recipe's files
) -> list[str]:
    """List paths in a YAML file that lie outside the folder of a recipe's files: a reader of the YAML could open them."""
    try:
        content = read_yaml(file)
    except (InvalidInput, RecursionError):
        return []
    texts = texts_in(content) if isinstance(content, dict) else ()
    folder = os.path.dirname(name) or "."
    return [text for text in texts if text.startswith(("/", "~")) or os.path.normpath(f"{folder}/{text}").split("/")[0] == ".."]
