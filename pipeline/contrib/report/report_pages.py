"""Files that reports wrote, with their keys: the list of a report, `report/pages.json`, and its checks."""

from collections.abc import Container
from pathlib import Path

from pydantic import Field, FiniteFloat, ValidationError

from pipeline.errors import StoreError, first_line
from pipeline.store.directory import changed_files
from pipeline.store.record import Name, RelativePath, Sha256, Stored
from pipeline.store.storage import Location, exists, list_folder, read_bytes

WRITTEN = "pages.json"


class WrittenFiles(Stored):
    """Files that were written under a key."""

    key: Sha256  # hash of all that the files show
    files: dict[RelativePath, Sha256]  # SHA-256 by path

    def is_up_to_date(self, key: str, changed: Container[str]) -> bool:
        """Check whether the files were written under this key, and none of them changed since."""
        return self.key == key and not any(name in changed for name in self.files)


class ObjectCard(WrittenFiles):
    """The files of an object's page, and facts for the gallery and the statistics; `areas` are those of its contacts, m²."""

    category: str
    split: str
    touches: int
    areas: tuple[FiniteFloat, ...]


class Pages(Stored):
    """The pages of objects, and the SHA-256 of every other file."""

    objects: dict[Name, ObjectCard] = Field(default={})
    files: dict[RelativePath, Sha256] = Field(default={})

    def every_file(self) -> dict[str, str]:
        """Collect the SHA-256 of every file, by its path below the report's folder."""
        return {name: sha256 for card in self.objects.values() for name, sha256 in card.files.items()} | self.files


def read_pages(report: Location) -> Pages:
    """Read the list of a report's files; raise a `StoreError` if it is missing or damaged."""
    path, remedy = report / WRITTEN, "run `vt-pipeline report` again"
    if not exists(path):
        raise StoreError(f"{path} is missing; {remedy}")
    try:
        return Pages.model_validate_json(read_bytes(path))
    except ValidationError as error:
        raise StoreError(f"{path} cannot be used ({first_line(error)}); {remedy}") from error


def refuse_report_links(report: Location) -> None:
    """Raise a `StoreError` if a report's folder is or holds a symbolic link, which would lead out of the dataset."""
    if isinstance(report, Path) and (link := next((path for path in (report, *report.rglob("*")) if path.is_symlink()), None)):
        raise StoreError(f"{link} is a symbolic link, which a report must not hold; remove it, then run `vt-pipeline report` again")


def report_problems(data: Location) -> dict[Location, list[str]]:
    """Check the report of a data directory if there is one: a line per changed file, by the path of the report's list."""
    report = data / "report"
    if not list_folder(report) and not (isinstance(report, Path) and report.is_symlink()):
        return {}
    try:
        refuse_report_links(report)
        changed = changed_files(report, read_pages(report).every_file())
    except StoreError as error:
        return {report / WRITTEN: [str(error)]}
    return {report / WRITTEN: [f"{name} {problem}; run `vt-pipeline report` again" for name, problem in changed.items()]}
