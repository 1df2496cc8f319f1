"""Lists of the files that reports and contact sheets wrote, with the keys of what they show."""

from collections.abc import Container
from pathlib import Path
from typing import TypeVar

from pydantic import Field, FiniteFloat, ValidationError

from pipeline.entries import Entries
from pipeline.errors import StoreError, first_line
from pipeline.store.directory import changed_files
from pipeline.store.record import Name, RelativePath, Sha256
from pipeline.store.storage import Location, exists, list_folder, read_bytes

WRITTEN, REMEDY = "pages.json", "run `vt-pipeline report` again"

Written = TypeVar("Written", bound=Entries)


class WrittenFiles(Entries):
    """Files that were written under a key."""

    key: Sha256  # hash of all that the files show
    files: dict[RelativePath, Sha256]

    def is_up_to_date(self, key: str, changed: Container[str]) -> bool:
        """Check whether the files were written under this key, and none of them changed since."""
        return self.key == key and not any(name in changed for name in self.files)


class ObjectCard(WrittenFiles):
    """The files of an object's page in a report, and facts for the gallery and the statistics."""

    category: str
    split: str
    touches: int
    areas: tuple[FiniteFloat, ...]  # of its contacts, m²


class Pages(Entries):
    """The files of a report: those of each object's page, and the others."""

    objects: dict[Name, ObjectCard] = Field(default={})
    files: dict[RelativePath, Sha256] = Field(default={})

    def every_file(self) -> dict[str, str]:
        """Collect the SHA-256 of every file, by its path below the report's folder."""
        return {name: sha256 for card in self.objects.values() for name, sha256 in card.files.items()} | self.files


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
        changed = changed_files(report, read_list(report / WRITTEN, Pages).every_file())
    except StoreError as error:
        return {report / WRITTEN: [str(error)]}
    return {report / WRITTEN: [f"{name} {problem}; {REMEDY}" for name, problem in changed.items()]}
