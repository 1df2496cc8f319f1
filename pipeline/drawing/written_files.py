"""Lists of the files that reports and contact sheets wrote."""

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from pipeline.entries import Entries
from pipeline.errors import StoreError, first_line
from pipeline.store.directory import changed_files
from pipeline.store.record import RelativePath, Sha256
from pipeline.store.storage import Location, exists, list_folder, read_bytes

WRITTEN, REMEDY = "pages.json", "run `vt-pipeline report` again"

Written = TypeVar("Written", bound=Entries)


class WrittenFiles(Entries, extra="ignore"):
    """The files that were written; what else a list holds is its writer's."""

    files: dict[RelativePath, Sha256]


def read_list(path: Location, kind: type[Written]) -> Written:
    """Read a list of files; raise a `StoreError` if it is missing or damaged."""
    if not exists(path):
        raise StoreError(f"{path} is missing; {REMEDY}")
    try:
        return kind.model_validate_json(read_bytes(path))
    except ValidationError as error:
        raise StoreError(f"{path} cannot be used ({first_line(error)}); {REMEDY}") from error


def refuse_links(report: Location) -> None:
    """Raise a `StoreError` if a report's folder is or holds a symbolic link, which would lead out of the dataset."""
    if isinstance(report, Path) and (link := next((path for path in (report, *report.rglob("*")) if path.is_symlink()), None)):
        raise StoreError(f"{link} is a symbolic link, which a report must not hold; remove it, then {REMEDY}")


def report_problems(data: Location) -> dict[Location, list[str]]:
    """Check the report of a data directory if there is one: a line per changed file, by the path of the report's list."""
    report = data / "report"
    if not list_folder(report) and not (isinstance(report, Path) and report.is_symlink()):
        return {}
    try:
        refuse_links(report)
        changed = changed_files(report, read_list(report / WRITTEN, WrittenFiles).files)
    except StoreError as error:
        return {report / WRITTEN: [str(error)]}
    return {report / WRITTEN: [f"{name} {problem}; {REMEDY}" for name, problem in changed.items()]}
