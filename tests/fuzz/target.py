"""What a target of wrong files is."""

from __future__ import annotations

import base64
import json
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from pipeline.store.digest import of_json
from tests.forked import answer

Files = dict[str, bytes]


class Target(ABC):
    """Something that reads files: sets of sound ones to begin with, and what reads them."""

    def __init__(self) -> None:
        self.seeds = self.sound()

    @abstractmethod
    def sound(self) -> list[Files]:
        """Return small sets of files that are read without complaint."""

    @abstractmethod
    def read(self, folder: Path, files: Files) -> None:
        """Read the files in a folder; only errors in words are allowed."""


def files_made_by(make: Callable[[Path], object]) -> Files:
    """Collect the files that a function writes into a folder; it runs in a process of its own, whose threads no later one inherits."""
    with tempfile.TemporaryDirectory() as root:
        folder = Path(root) / "made"

        def made() -> dict[str, str]:
            make(folder)
            found = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
            return {name: base64.b64encode(path.read_bytes()).decode() for name, path in found.items()}

        return {name: base64.b64decode(content) for name, content in answer(made, Path(root) / "log").items()}


def seal(record: Path, changes: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Change a record, and give it the checksum of its content, as a stranger would; one that is no JSON object stays as it is."""
    with suppress(ValueError, RecursionError, OSError, KeyError, TypeError, AttributeError):
        content = json.loads(record.read_bytes())
        content |= changes(content)
        content.pop("checksum", None)
        record.write_text(json.dumps({"checksum": of_json(content), **content}))
