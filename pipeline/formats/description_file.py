"""Description files of manifests, hands, sensors, scenes and clusters: shipped ones by name, others by the path of a YAML file."""

import os
import re
from collections import Counter
from collections.abc import Collection, Iterator
from datetime import date
from importlib import resources
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from pipeline import plugins
from pipeline.errors import InvalidInput, closest_name
from pipeline.formats.file_content import expanded, read_text

Kind = Literal["manifest", "hand", "sensor", "scene", "cluster", "observation", "about"]
Model = TypeVar("Model", bound=BaseModel)
UNION_MEMBER = re.compile(r"(literal|tuple)\[.*\]|constrained-[a-z]+|str|int|float|bool")
"""Part of a location in pydantic's errors that is no entry but the type tried, where an entry may have several."""
MAX_BYTES, MAX_DEPTH = 10 * 2**20, 40  # limits of a description file: a larger one would take minutes to read


def shipped_files(kind: Kind) -> dict[str, Path]:
    """List the files that come with this package and with plugins, by name."""
    return {name: files[0][0] for name, files in _files_by_name(kind).items()}


def _files_by_name(kind: Kind) -> dict[str, list[tuple[Path, str]]]:
    """List the files of each name, this package's first, with the packages that they come with."""
    package = Path(str(resources.files("pipeline")))
    folder = package.parent / "data_manifests" if kind == "manifest" else package / "assets" / f"{kind}s"
    files = {file.stem: [(file, "vt-pipeline")] for file in sorted(folder.glob("*.yaml"))}
    for entry in plugins.declared(f"{kind}s"):
        for file in plugins.folder_files(entry):
            files.setdefault(file.stem, []).append((file, plugins.package_of(entry)))
    return files


def description_path(kind: Kind, name: str | Path) -> Path:
    """Find a description file by the name of a shipped one or by its path; the message of a missing one lists the shipped ones."""
    if not isinstance(name, str | Path):
        raise TypeError(f"a {kind} is the name of a shipped one or the path of a YAML file; this is {type(name).__name__}")
    shipped = _files_by_name(kind)
    files = shipped.get(str(name), [(expanded(name), "")])
    plugins.check_unique(kind, str(name), [owner for _, owner in files])
    path = files[0][0]
    if not os.path.isfile(path):
        neighbours = {file.name: file for file in islice(path.parent.glob("*.y*ml"), 1000)} if path.parent.is_dir() else {}
        similar = neighbours.get(closest_name(path.name, neighbours) or "")
        guess = closest_name(name, shipped) or similar or closest_name(path.name, shipped)
        hint = f", did you mean {guess}?" if guess else ";"
        empty = [
            f"; package {plugins.package_of(entry)} names {entry.value} as its folder of {kind}s, which has no YAML files"
            for entry in plugins.declared(f"{kind}s")
            if not plugins.folder_files(entry)
        ]
        remedy = f"built in are {', '.join(shipped)}, or give the path of a YAML file{''.join(empty)}"
        raise InvalidInput(f"there is no {kind} {str(name)!r}{hint} {remedy}")
    return path


def read_description(kind: Kind, path: Path, model: type[Model], *parts: type[BaseModel]) -> Model:  # `parts` are what its schema lacks
    """Read and validate a description file; the message names the file and every entry that is missing, unknown or unusable."""
    try:
        return model.model_validate(read_yaml(path, f"{kind} file"))
    except ValidationError as error:
        raise InvalidInput(with_entries(f"{kind} file {path}: {invalid_entries(error, entry_names(model, *parts))}", model)) from error


def with_entries(reason: str, model: type[BaseModel]) -> str:
    """End a sentence about unusable entries of a file, and list those of its model."""
    names = ", ".join(field.alias or name for name, field in model.model_fields.items() if not field.exclude)
    return f"{reason}{'' if reason.endswith('?') else '.'} The file's entries are {names}"


def read_yaml(
    path: Path,
    kind: str = "",  # of file, for messages
) -> Any:
    """Read a YAML file; see `parse_yaml`."""
    return parse_yaml(read_text(path, MAX_BYTES), f"{kind} {path}".lstrip())


def parse_yaml(
    text: str,
    source: str,  # its file, for messages
) -> Any:
    """Parse YAML without aliases, which make the size of what is read unbounded, and without tags such as `!!float`."""
    try:
        if len(text) > MAX_BYTES:
            raise ValueError(f"it has {len(text)} characters; {MAX_BYTES} are the most that are read")
        depth = 0
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent):
                raise ValueError(f"it has an alias, *{event.anchor}; write out what it stands for")
            if tag := getattr(event, "tag", None):
                raise ValueError(f"it has a tag, {tag}; write the value alone")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise ValueError(f"its entries are nested more than {MAX_DEPTH} deep")
        return yaml.load(text, Loader=_UniqueEntries)
    except (ValueError, yaml.YAMLError) as error:
        reason = ", ".join(line.strip() for line in str(error).replace('in "<unicode string>", ', "").splitlines())
        raise InvalidInput(f"{source} cannot be read as YAML: {reason}") from error


class _UniqueEntries(yaml.CSafeLoader):
    """Refuses duplicate entries, of which YAML's readers keep the last."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        counts = Counter((key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        if twice := [name for (_, name), count in counts.items() if count > 1]:
            raise ValueError(f"its entry {twice[0]} is there twice; keep one")
        return super().construct_mapping(node, deep)


def texts_in(content: Any) -> Iterator[str]:
    """Yield every string in the content of a YAML file; the names of other files are among them."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict | list):
        for part in content.values() if isinstance(content, dict) else content:
            yield from texts_in(part)


def invalid_entries(error: ValidationError, names: Collection[str] = ()) -> str:
    """Name every unusable entry, with the reason and a short value; suggest the closest one of `names`, all entries."""
    details: list[Any] = error.errors()
    locations = [item["loc"] for item in details]
    known = {*names, *(str(item["loc"][-1]) for item in details if item["type"] == "missing")}
    guesses = {  # the same name in another part of the file is no suggestion
        item["loc"]: closest_name(item["loc"][-1], known - {item["loc"][-1]}) for item in details if item["type"] == "extra_forbidden"
    }
    misspelt = {(*location[:-1], name) for location, name in guesses.items()}
    choices = {item["loc"]: re.findall("'([^']*)'", item["ctx"]["expected"]) for item in details if item["type"] == "literal_error"}
    guesses |= {item["loc"]: closest_name(item["input"], choices[item["loc"]]) for item in details if item["loc"] in choices}
    lines: dict[str, list[str]] = {}  # by entry: one that may be of several types has an error for each
    for item in details:
        location = item["loc"]
        inside = any(other[: len(location)] == location and other != location for other in locations)
        if location in misspelt or (item["type"] == "too_short" and inside):  # both follow from another error
            continue
        if item["type"] == "union_tag_not_found":
            location = (*location, item["ctx"]["discriminator"].strip("'"))
        value = "" if item["type"] == "value_error" else _quoted_value(item["input"])  # our own messages state the value
        name = ".".join(str(part) for part in location if part != "[key]" and not UNION_MEMBER.fullmatch(str(part)))
        lines.setdefault(name, []).append(_describe(item["type"], name, item["msg"], guesses.get(location), value))
    return "; ".join(", or ".join([first, *(line.removeprefix(f"{name}: ") for line in rest)]) for name, (first, *rest) in lines.items())


def _quoted_value(value: object) -> str:
    """Quote a number, a string, a date or null, if it is short."""
    if value is None:
        return " (it is null)"
    if isinstance(value, date):
        return f" (it is the date {value})"
    short = len(value) <= 60 if isinstance(value, str) else abs(value) < 10**60 if isinstance(value, int) else isinstance(value, float)
    return f" (it is {value!r})" if short else ""


def entry_names(*models: type[BaseModel]) -> set[str]:
    """List the names of all entries of models and of the models in them."""
    schemas = [model.model_json_schema() for model in models]
    return {name for schema in schemas for part in (schema, *schema.get("$defs", {}).values()) for name in part.get("properties", {})}


def _describe(kind: str, name: str, message: str, guess: str | None, value: str) -> str:
    if kind == "extra_forbidden":
        return f"there is no entry {name}" + (f", did you mean {guess}?" if guess else "")
    if kind in ("missing", "union_tag_not_found"):
        return f"entry {name} is missing"
    if kind == "string_type":  # YAML reads 0, yes, null and 2026-01-01 as other things
        return f"{name}: it must be text{value}" + ("; put it in quotes" if value else "")
    expected = {"tuple_type": "it must be a list, [VALUE, …]", "model_type": "it must be a mapping, {NAME: VALUE, …}"}
    message = expected.get(kind, message.removeprefix("Value error, ")) + (f", did you mean {guess}?" if guess else value)
    return f"{name}: {message}" if name else message
