"""Base class of fuzzing targets."""

import base64
import json
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from checks.forked import answer
from pipeline.store.digest import of_json

Files = dict[str, bytes]


class Target(ABC):
    """A reader of files and sets of valid files to mutate."""

    def __init__(self) -> None:
        self.seeds = self.sound()

    @abstractmethod
    def sound(self) -> list[Files]:
        """Return small sets of files that are read without errors."""

    @abstractmethod
    def read(self, folder: Path, files: Files) -> None:
        """Read the files in a folder; only errors of the pipeline are allowed."""


def files_made_by(make: Callable[[Path], object]) -> Files:
    """Collect the files that a function writes into a folder; it runs in a separate process, so that later forks inherit no threads."""
    with tempfile.TemporaryDirectory() as root:
        folder = Path(root) / "made"

        def encoded_files() -> dict[str, str]:
            make(folder)
            paths = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
            return {name: base64.b64encode(path.read_bytes()).decode() for name, path in paths.items()}

        return {name: base64.b64decode(content) for name, content in answer(encoded_files, Path(root) / "log").items()}


def seal(record: Path, changes: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Change a record and update its checksum, as an attacker would; a record that is not a JSON object stays unchanged."""
    with suppress(ValueError, RecursionError, OSError, KeyError, TypeError, AttributeError):
        content = json.loads(record.read_bytes())
        content |= changes(content)
        content.pop("checksum", None)
        record.write_text(json.dumps({"checksum": of_json(content), **content}))
