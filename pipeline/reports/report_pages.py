"""The list of a report's files, `report/pages.json`, and whether they are as they were written."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict, FiniteFloat, ValidationError

from pipeline.errors import StoreError, first_line
from pipeline.store.record import Name, RelativePath, Sha256
from pipeline.store.storage import Place, exists, in_threads, names_in, read_bytes

WRITTEN = "pages.json"


class ObjectCard(BaseModel):
    """What is known of the page of an object.

    Attributes
    ----------
    key
        The hash of all that its files show.
    category, split, touches, areas
        For the gallery and the statistics; `areas` are those of its contacts, m².
    files
        The SHA-256 of each of its files.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: Sha256
    category: str
    split: str
    touches: int
    areas: tuple[FiniteFloat, ...]
    files: dict[RelativePath, Sha256]


class Pages(BaseModel):
    """The pages of objects, and the SHA-256 of every other file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    objects: dict[Name, ObjectCard] = {}
    files: dict[RelativePath, Sha256] = {}

    def every_file(self) -> dict[str, str]:
        """The SHA-256 of every file, by its path below the report's folder."""
        return {name: written for card in self.objects.values() for name, written in card.files.items()} | self.files


def read_pages(report: Place) -> Pages:
    """Read the list of a report's files; a `StoreError` where there is none, or one that cannot be used."""
    path, remedy = report / WRITTEN, "run `vt-pipeline report` again"
    if not exists(path):
        raise StoreError(f"{path} is missing; {remedy}")
    try:
        return Pages.model_validate_json(read_bytes(path))
    except ValidationError as error:
        raise StoreError(f"{path} cannot be used ({first_line(error)}); {remedy}") from error


def changed_files(report: Place, files: Mapping[str, str]) -> list[str]:
    """List those of some files, given with their SHA-256, that are missing or not as they were written."""

    def is_changed(name: str) -> bool:
        return not exists(report / name) or hashlib.sha256(read_bytes(report / name)).hexdigest() != files[name]

    names = list(files)
    return [name for name, changed in zip(names, in_threads(is_changed, names), strict=True) if changed]


def refuse_report_links(report: Place) -> None:
    """Raise a `StoreError` where a report's folder, or anything in it, is a symbolic link: it leads out of the dataset."""
    if isinstance(report, Path) and (link := next((path for path in (report, *report.rglob("*")) if path.is_symlink()), None)):
        raise StoreError(f"{link} is a symbolic link; a report has none: remove it, then run `vt-pipeline report` again")


def report_problems(data: Place) -> dict[Place, list[str]]:
    """Check the report of a data directory, where there is one: the path of its list, and a line for each file that is not as written."""
    report = data / "report"
    if not names_in(report) and not (isinstance(report, Path) and report.is_symlink()):
        return {}
    try:
        refuse_report_links(report)
        changed = changed_files(report, read_pages(report).every_file())
    except StoreError as error:
        return {report / WRITTEN: [str(error)]}
    return {report / WRITTEN: [f"{name} is missing or was changed; run `vt-pipeline report` again" for name in changed]}
