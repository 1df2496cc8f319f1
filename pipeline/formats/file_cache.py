"""Values computed from files, kept between runs: reading a hand's meshes takes seconds, parsing all code a second."""

import math
import pickle
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

MAX_BYTES = 20_000_000  # of a value that is kept: reading it takes 10 ms
Stamps = dict[str, list[int]]  # times, number and size of files, by their paths


class FileCache:
    """Values by name, in a file. One counts until a file that it was computed from, or the code that computes it, is written.

    Open it before the files are read: a value is not kept if one of them was written since. `code` are the stamps of the code as it was
    imported. Values are pickled: the file must be as hard to write to as compiled modules, beside which it lies.
    """

    def __init__(self, path: Path, code: Stamps | None, limit: int) -> None:
        self._path, self._code, self._limit = path, code, limit
        self._kept: dict[str, tuple[bytes, Stamps]] = {}
        self._changed, self.opened = False, time.time_ns()
        with suppress(Exception):  # none, a damaged one, or that of another version
            written_by, kept = pickle.loads(path.read_bytes())
            if written_by == self._code:
                self._kept = kept

    def find(self, name: str) -> Any:
        """Return a value; None if there is none, or one of its files was written or replaced."""
        value, stamps = self._kept.get(name, (b"", None))
        with suppress(Exception):  # as of another version of a library
            return pickle.loads(value) if stamps and stamps == stamps_of(map(Path, stamps)) else None
        return None

    def keep(self, name: str, value: Any, files: Iterable[Path]) -> None:
        """Keep a value of at most `MAX_BYTES` that was computed from files; beyond the limit, the oldest goes."""
        self._kept.pop(name, None)
        content, stamps = pickle.dumps(value), stamps_of(files, self.opened)
        if stamps and len(content) <= MAX_BYTES:
            self._kept = dict([*self._kept.items()][1 - self._limit :]) | {name: (content, stamps)}
            self._changed = True

    def save(self) -> None:
        """Write what is new, if the folder can be written to."""
        if self._changed:
            unfinished = self._path.with_name(f"{self._path.name}.{uuid4().hex}")
            with suppress(OSError):
                unfinished.parent.mkdir(exist_ok=True)
                try:
                    unfinished.write_bytes(pickle.dumps((self._code, self._kept)))
                    unfinished.replace(self._path)
                finally:
                    unfinished.unlink(missing_ok=True)  # as where the disk is full


def stamps_of(paths: Iterable[Path], before: float = math.inf) -> Stamps | None:
    """Return what changes whenever one of the files is written or replaced; None if one is missing, or was written after `before`, ns."""
    try:
        states = {str(path): path.stat() for path in paths}
    except OSError:
        return None
    if any(state.st_ctime_ns >= before for state in states.values()):
        return None
    return {path: [state.st_mtime_ns, state.st_ctime_ns, state.st_ino, state.st_size] for path, state in states.items()}
