"""Values computed from files, kept between runs: reading a hand's meshes takes seconds, parsing all code a second."""

import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

Stamps = dict[str, list[int]]  # times, number and size of files, by their paths


class FileCache:
    """JSON values by name, in a file. One counts until a file that it was computed from, or the code that computes it, is written."""

    def __init__(self, path: Path, code: Iterable[Path], limit: int) -> None:
        self._path, self._code, self._limit = path, stamps_of(code), limit
        self._kept: dict[str, tuple[Any, Stamps | None]] = {}
        self._changed = False
        with suppress(OSError, ValueError, KeyError, TypeError):
            stored = json.loads(path.read_bytes())
            if stored["code"] == self._code:
                self._kept = dict(stored["kept"])

    def find(self, name: str) -> Any:
        """Return a value; None if there is none, or one of its files was written or replaced."""
        with suppress(ValueError, KeyError, TypeError):
            value, stamps = self._kept[name]
            if stamps and stamps == stamps_of(map(Path, stamps)):
                return value
        return None

    def keep(self, name: str, value: Any, files: Iterable[Path]) -> None:
        """Keep a value that was computed from files; beyond the limit, the oldest goes."""
        self._kept.pop(name, None)
        self._kept = dict([*self._kept.items()][1 - self._limit :]) | {name: (value, stamps_of(files))}
        self._changed = True

    def save(self) -> None:
        """Write what is new, if the folder can be written to."""
        if self._changed:
            unfinished = self._path.with_name(f"{self._path.name}.{uuid4().hex}")
            with suppress(OSError):
                unfinished.parent.mkdir(exist_ok=True)
                unfinished.write_text(json.dumps({"code": self._code, "kept": self._kept}))
                unfinished.replace(self._path)


def stamps_of(paths: Iterable[Path]) -> Stamps | None:
    """Return what changes whenever one of the files is written or replaced; None if one is missing."""
    try:
        states = {str(path): path.stat() for path in paths}
    except OSError:
        return None
    return {path: [state.st_mtime_ns, state.st_ctime_ns, state.st_ino, state.st_size] for path, state in states.items()}
