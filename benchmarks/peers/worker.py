"""A peer that lives in another environment: a process that answers JSON lines and takes its times inside."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks.provenance import ROOT


class PeerError(RuntimeError):
    """A peer cannot run here; the message says why."""


class Worker:
    """A module run by another Python. Use it as a context manager.

    Raises
    ------
    PeerError
        The interpreter is missing, or the process ended; the message holds the last of what it said.
    """

    def __init__(self, python: Path, module: str, arguments: Sequence[str], log: Path) -> None:
        if not python.exists():
            raise PeerError(f"{python} is missing; `make bench-peers` installs it")
        self._log = log
        command = [str(python), "-m", module, *arguments]
        with log.open("w") as errors:
            self._process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True)
        self.greeting = self._answer()

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a request."""
        assert self._process.stdin
        with suppress(BrokenPipeError):  # the process has ended: what it said is below
            print(json.dumps(request), file=self._process.stdin, flush=True)
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout
        line = self._process.stdout.readline()
        if not line:
            self._process.communicate()
            said = self._log.read_text().strip().splitlines()
            raise PeerError(f"it ended with status {self._process.returncode}: {said[-1] if said else 'without a word'}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._process.returncode is None:
            self._process.communicate()
