"""Recipes: everything that is needed to make a dataset again, with digests to verify it.

A recipe is a YAML file of a few kilobytes and one line per object. It may come from a stranger: no name in it may be a path outside the
folders that its user gives.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import yaml
from pydantic import AfterValidator, Field, JsonValue, ValidationError

from pipeline.config.folder_sources import FolderSource, ShapeNet
from pipeline.config.manifest import OBJECT_ID, Manifest
from pipeline.config.sources import Pybullet
from pipeline.console import CONTROLS
from pipeline.entries import Entries
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import entry_names, invalid_entries, parse_yaml, with_entries
from pipeline.formats.file_content import read_text
from pipeline.store import digest
from pipeline.store.record import Name, Sha256, Text

MAX_BYTES = 2**28  # maximum size of a recipe: 200 bytes for each of a million objects, and some more
MAX_NAME_BYTES = 255  # maximum length of a path in a recipe: file systems accept no longer name

SHORT_DIGITS = 16  # hexadecimal, of a row's digest in a recipe: enough to name a row that differs; the roots have 64

MAX_TEXTS, TEXT_SUFFIXES = 100, (".yaml", ".yml", ".urdf", ".xml", ".mtl")
"""Text files that a recipe may hold, which `remake` writes: their maximum number, and suffixes of files that nothing executes."""

OBJECTS = "\nobjects: |\n"  # the line between the head of a recipe and the lines of its objects

_LINE = re.compile(rf"({OBJECT_ID.pattern}) ([0-9a-f]{{64}}(?:\+[0-9a-f]{{16}})?|~[0-9a-f]{{16}})((?: [0-9a-f]{{16}}(?:[0-9a-f]{{48}})?)+)")


class StageRecipe(Entries):
    """The output of a stage, and the settings, code and files that made it."""

    # those that results depend on; a hand, sensor or scene that does not come with a package is the name of a file
    settings: dict[Name, JsonValue]
    schema_version: int  # of the artifact
    code: Sha256  # hash of the stage's code
    files: Sha256  # hash of the contents of its hand, sensor and scene files
    constants: Sha256  # digest of the arrays without an object dimension
    roots: tuple[Sha256, ...]  # one digest per shard, of the digests and splits of its rows and of the constants


class RecipeRow(NamedTuple):
    """An object of a recipe."""

    source: str  # hash of its source
    digests: tuple[str, ...]  # of its row in the artifact of each stage, or their beginnings


def check_file_name(name: str) -> str:
    """Refuse a name that is no path below a folder, or that of a hidden file."""
    parts = name.split("/")
    odd = "" in parts or any(part.startswith(".") for part in parts) or name.startswith("~") or "\\" in name or CONTROLS.search(name)
    if odd or len(name.encode()) > MAX_NAME_BYTES:
        rule = f"without .., ~, a leading /, hidden or odd names, of at most {MAX_NAME_BYTES} bytes"
        raise ValueError(f"{name[:80]!r} must be a path below its folder, {rule}")
    return name


def _with_safe_paths(manifest: Manifest) -> Manifest:
    """Refuse sources that name files outside the folder that the user gives, or outside the package that holds them."""
    for source in manifest.sources:
        names: list[str | None] = []
        if isinstance(source, FolderSource) and source.path is not None:
            if len(source.path.parts) != 1:
                raise ValueError(f"path {str(source.path)[:80]!r} of a source must be the name of a folder")
            names.append(str(source.path))
        if isinstance(source, Pybullet):
            names += [entry.file for entry in source.files.values()]
        if isinstance(source, ShapeNet):
            names += [*source.synsets.values(), source.renderings, None if source.meshes == "." else source.meshes]
        for name in filter(None, names):
            check_file_name(name)
    return manifest


def _check_text_name(name: str) -> str:
    if not name.endswith(TEXT_SUFFIXES):
        raise ValueError(f"{name[:80]!r} is no name of a text file of a hand, sensor or scene: these end in {', '.join(TEXT_SUFFIXES)}")
    return check_file_name(name)


class _Dumper(yaml.SafeDumper):
    """Writes strings of several lines as literal blocks, where YAML can."""


_Dumper.add_representer(
    str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)
)


class Recipe(Entries):
    """Everything that is needed to make a dataset again."""

    recipe: Literal[1] = 1  # the format's version
    # the objects; a folder of meshes has no path here, or the name of its folder where there are several
    manifest: Annotated[Manifest, AfterValidator(_with_safe_paths)]
    preset: Text  # the preset that the settings began with: a name for readers
    seed: int = Field(ge=0)  # the root seed
    shards: int = Field(ge=1, le=9999)  # number that the objects were split into; a remade dataset may have another
    stages: dict[Name, StageRecipe] = Field(min_length=1, max_length=20)  # by name, in their order
    # of the libraries that results may depend on; several are separated by commas
    versions: dict[Name, Annotated[str, Field(pattern=r"^[A-Za-z0-9.+!_-]{1,60}(, [A-Za-z0-9.+!_-]{1,60})*$")]]
    processors: tuple[Annotated[Text, Field(max_length=2000)], ...] = ()  # the kinds that computed rows
    # hand, sensor and scene files that come with no package, and small files that they name, by paths in one folder
    texts: dict[Annotated[str, AfterValidator(_check_text_name)], str] = Field(
        default_factory=dict, max_length=MAX_TEXTS, exclude_if=lambda value: not value
    )
    # SHA-256 of the others that these name: meshes, pictures
    files: dict[Annotated[str, AfterValidator(check_file_name)], Sha256] = Field(
        default_factory=dict, max_length=10_000, exclude_if=lambda value: not value
    )
    # where these can be downloaded
    files_url: Annotated[str | None, Field(pattern="^https?://[!-~]{1,1000}$", exclude_if=lambda value: value is None)] = None
    checksums: dict[Name, Sha256] = Field(default_factory=dict)  # hash of every other entry; each stage counts as one
    objects: str  # a line per object, in order of their ids: its id, source and rows (`rows`)

    @cached_property
    def rows(self) -> Mapping[str, RecipeRow]:
        """The objects by id; an `InvalidInput` names the first line that cannot be used."""
        return dict(self._parsed())

    def _parsed(self) -> Iterator[tuple[str, RecipeRow]]:
        previous = ""
        for number, line in enumerate(self.objects.splitlines(), 1):
            match = _LINE.fullmatch(line)
            digests = tuple(match[3].split()) if match else ()
            if not match or not OBJECT_ID.fullmatch(match[1]) or len(digests) != len(self.stages):
                expected = f"an id, its source's hash and {len(self.stages)} digests"
                raise InvalidInput(f"line {number} of its objects, {line[:80]!r}, must have {expected}")
            if match[1] <= previous:
                raise InvalidInput(f"line {number} of its objects: {match[1]} follows {previous}; they must be in order, each once")
            previous = match[1]
            yield previous, RecipeRow(match[2], digests)
        if not previous:
            raise InvalidInput("it has no objects")

    def entry_hashes(self) -> dict[str, str]:
        """Compute the hash of every entry, for `checksums`."""
        content = self.model_dump(mode="json", exclude={"checksums"})
        stages = content.pop("stages")
        return {name: digest.of_json(value) for name, value in {**content, **stages}.items()}

    def text(self) -> str:
        """Write the recipe as YAML, with its checksums."""
        head = self.model_dump(mode="json", exclude={"objects", "checksums", "manifest"})
        manifest = self.manifest.model_dump(mode="json", exclude_none=True)
        content = {"recipe": head.pop("recipe"), "manifest": manifest, **head, "checksums": self.entry_hashes()}
        entries = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=140)
        lines = "".join(f"  {line}\n" for line in self.objects.splitlines())
        about = "# Makes a dataset of visuotactile grasps again and compares it: vt-pipeline remake THIS-FILE --data FOLDER"
        return f"{about}\n{entries.rstrip()}{OBJECTS}{lines}"


def read_recipe(path: Path) -> Recipe:
    """Read a recipe; an `InvalidInput` names the file and every entry that cannot be used, or was changed since."""
    head, _, lines = read_text(path, MAX_BYTES).replace("\r\n", "\n").partition(OBJECTS)  # as git may write it on Windows
    content = parse_yaml(head, f"recipe {path}")
    if not isinstance(content, dict) or "recipe" not in content:
        raise InvalidInput(f"{path} is no recipe: it has no entry `recipe`; `vt-pipeline recipe DATA > FILE` writes one")
    if content["recipe"] != 1:
        raise InvalidInput(f"recipe {path} has version {content['recipe']!r:.40}, this vt-pipeline reads 1; use the version that wrote it")
    try:
        recipe = Recipe.model_validate({**content, "objects": "".join(line.removeprefix("  ") for line in lines.splitlines(True))})
        recipe.rows  # noqa: B018 (an error where a line cannot be used)
        changed = sorted({name for name, _ in recipe.entry_hashes().items() ^ recipe.checksums.items()})
    except ValidationError as error:
        raise InvalidInput(with_entries(f"recipe {path}: {invalid_entries(error, entry_names(Recipe))}", Recipe)) from error
    except ValueError as error:
        raise InvalidInput(f"recipe {path}: {error}") from error
    if wrong := [name for name, stage in recipe.stages.items() if len(stage.roots) != recipe.shards]:
        raise InvalidInput(f"recipe {path}: {wrong[0]} has {len(recipe.stages[wrong[0]].roots)} roots, its shards are {recipe.shards}")
    if changed:
        raise InvalidInput(
            f"recipe {path}: its {', '.join(changed)} changed since it was written, by hand or on its way; get it again where it was "
            "published. For a dataset of your own, change a manifest and settings, make it, and write its recipe"
        )
    return recipe


def object_lines(rows: Iterable[tuple[str, RecipeRow]]) -> str:
    """Write the lines of objects, in order of their ids."""
    return "".join(f"{name} {row.source} {' '.join(row.digests)}\n" for name, row in sorted(rows))
