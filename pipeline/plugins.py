"""Extensions, of `pipeline.contrib` and of other packages: stages, schemas, hands, sensors, sources, commands and exports.

They are found by entry points in the metadata of installed packages.

Listing reads metadata alone. A package's code is imported when its extension is used.
"""

import traceback
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pipeline.errors import InvalidInput, PipelineError, unknown_name


@cache
def declared(group: str) -> tuple[EntryPoint, ...]:
    """List the entry points of `vt_pipeline.GROUP`, by name."""
    return tuple(sorted(entry_points(group=f"vt_pipeline.{group}"), key=lambda entry: (entry.name, package_of(entry))))


def package_of(entry: EntryPoint) -> str:
    """Name the package that declares an entry point."""
    return entry.dist.name if entry.dist else "?"


def load(entry: EntryPoint, error_type: type[PipelineError]) -> Any:
    """Import what an entry point names; an error of `error_type` names the package and the line that failed."""
    try:
        return entry.load()
    except Exception as error:  # whatever a module may raise
        frame = traceback.extract_tb(error.__traceback__)[-1]
        raise error_type(
            f"{entry.name} of package {package_of(entry)}: {entry.value} cannot be imported: {type(error).__name__}: {error} "
            f"({frame.filename}, line {frame.lineno}); fix it, or `pip uninstall {package_of(entry)}`"
        ) from error


def find(group: str, name: str) -> Any:
    """Import what a package declares under a name in `vt_pipeline.GROUP`."""
    entries, kind = {entry.name: entry for entry in declared(group)}, group.removesuffix("s")
    if name not in entries:
        raise InvalidInput(f"{unknown_name(kind, name, entries)}; install the package that brings it")
    check_unique(kind, name, [package_of(entry) for entry in declared(group) if entry.name == name])
    return load(entries[name], InvalidInput)


def named(group: str, name: str, kind: type) -> Any:
    """Import the subclass of `kind` that a package declares under a name in `vt_pipeline.GROUP`."""
    loaded = find(group, name)
    if not (isinstance(loaded, type) and issubclass(loaded, kind)):
        raise InvalidInput(f"{group.removesuffix('s')} {name} is no {kind.__name__}, but {loaded!r}; uninstall the package that brings it")
    return loaded


def check_unique(kind: str, name: str, packages: list[str]) -> None:
    """Raise an `InvalidInput` that names the packages, if more than one provides this name."""
    if len(packages) > 1:
        raise InvalidInput(f"{kind} {name} is provided by more than one package: {', '.join(packages)}; uninstall one, or rename it there")


def folder_files(entry: EntryPoint) -> list[Path]:
    """List the YAML files in the folder `PACKAGE.FOLDER` that an entry point names, without importing the package."""
    top, *subpackages = entry.value.split(".")
    spec = find_spec(top) if top.isidentifier() else None
    roots = spec.submodule_search_locations if spec else None
    return [file for root in roots or () for file in sorted(Path(root, *subpackages).glob("*.yaml"))]
