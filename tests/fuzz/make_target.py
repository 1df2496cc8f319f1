"""Variables of the Makefile: any values are passed on unchanged or refused, and run no command."""

from __future__ import annotations

import os
import shutil
import subprocess
import zlib
from collections.abc import Mapping
from pathlib import Path

from pipeline.errors import InvalidInput
from tests.fuzz.target import Files, Target

ROOT = Path(__file__).parents[2]
CANARY = "canary"
PASSED = ("MANIFEST", "PRESET", "DATA", "OBJECTS", "UNITS", "UP", "SET", "WORKERS")
"""In the order of the arguments of `vt-pipeline run`."""
OPTIONAL = ("OBJECTS", "UNITS", "UP")
REFUSED = (b"has a line break", b"must be a whole number", b"must be whole numbers", b"is damaged", b"list too long", b"name too long")
ANSWERS = 'case "$2" in *ensurepip*) echo 3.13 yes yes /usr ;; *) echo 4 ;; esac'
"""Answers of Python about itself to tools/install.sh, and about the shards of a dataset to tools/shards.sh."""
NEEDED = ("sh", "head", "tr", "seq", "touch", "env")
SOUND = {
    "plain": {"MANIFEST": b"toy", "PRESET": b"draft", "DATA": b"d", "SET": b"a.b=1 c=[1,2]", "SHARDS": b"2", "SEEDS": b"0 1"},
    "quoted": dict.fromkeys((*PASSED, "CONFIGURATIONS"), f"'; touch {CANARY}; '".encode()),
    "doubly": dict.fromkeys((*PASSED, "SEEDS"), f'"; touch {CANARY}; "'.encode()),
    "substituted": dict.fromkeys((*PASSED, "SHARDS"), f"$(touch {CANARY})`touch {CANARY}`".encode()),
    "expanded": dict.fromkeys((*PASSED, "CONFIGURATIONS", "SEEDS"), f"$(shell touch {CANARY})$$(touch {CANARY})".encode()),
    "lines": dict.fromkeys(PASSED, f"a\n\ttouch {CANARY}\n".encode()),
    "control": dict.fromkeys(PASSED, f" a;touch {CANARY} & touch {CANARY} | touch {CANARY} # \\".encode()),
    "make": {"DATA": f"$(eval $(shell touch {CANARY}))$(file >{CANARY},)$@$<$*".encode(), "SET": b"%:|=,()$()${x}"},
}


class MakeVariables(Target):
    """Values on the command line or in the environment of make, and a dataset description with a number of shards."""

    def sound(self) -> list[Files]:
        return [values | {"dataset.json": b'{"shards": 3}'} for values in SOUND.values()]

    def read(self, folder: Path, files: Files) -> None:
        work = folder / "work"
        if not work.exists():
            _make_workplace(work)
        (work / "d" / "dataset.json").write_bytes(files["dataset.json"])
        values = {name: value.replace(b"\0", b"") for name, value in files.items() if name != "dataset.json"}
        content = zlib.crc32(b"".join(files.values()))
        expected = set(work.iterdir())
        _run(work, values, content, "-n", "sample-surfaces.0", "report")
        if (work / "log").exists():
            raise RuntimeError("make -n called a program")
        if content % 8 == 0:
            _run(work, values, content, "report")
            (work / "log").unlink(missing_ok=True)
        refused = _run(work, values, content, "sample-surfaces.0")
        calls = (work / "log").read_bytes().split(b"\0\n")[:-1] if (work / "log").exists() else []
        (work / "log").unlink(missing_ok=True)
        if set(work.iterdir()) != expected:
            raise RuntimeError(f"made {sorted(path.name for path in set(work.iterdir()) - expected)}")
        if refused:
            if calls or not any(words in refused for words in REFUSED):
                raise RuntimeError(refused.decode(errors="replace"))
            raise InvalidInput(refused.decode(errors="replace"))
        if [_without_shards(call.split(b"\0")) for call in calls] != [_arguments(values, in_environment=bool(content % 2))]:
            raise RuntimeError(f"called with {calls}")


def _make_workplace(work: Path) -> None:
    shutil.copytree(ROOT / "tools", work / "tools")
    shutil.copy(ROOT / "Makefile", work)
    for folder in ("d", "programs", ".venv/bin"):
        (work / folder).mkdir(parents=True)
    for name in NEEDED:
        (work / "programs" / name).symlink_to(str(shutil.which(name)))
    for name, script in (("vt-pipeline", r"""printf '%s\0' "$@" >>log; echo >>log"""), ("python", ANSWERS)):
        (work / ".venv" / "bin" / name).write_text(f"#!/bin/sh\n{script}\n")
        (work / ".venv" / "bin" / name).chmod(0o755)
    (work / ".venv" / "installed").touch()


def _run(work: Path, values: Mapping[str, bytes], content: int, *targets: str) -> bytes:
    """Run make, with the values in its environment if `content` is odd; return its error if it fails."""
    pairs = {os.fsencode(name): value for name, value in values.items()}
    environment = {b"PATH": os.fsencode(work / "programs"), **(pairs if content % 2 else {})}
    arguments = [] if content % 2 else [name + b"=" + value for name, value in pairs.items()]
    command: list[str | bytes] = [str(shutil.which("make")), *targets, *arguments]
    try:
        completed = subprocess.run(command, cwd=work, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    except OSError as error:
        raise InvalidInput(str(error)) from error
    return completed.stderr + b"failed" if completed.returncode else b""


def _arguments(values: Mapping[str, bytes], *, in_environment: bool) -> list[bytes]:
    """List the arguments that make must pass to `vt-pipeline`; on its command line, make drops leading blanks."""
    passed = {name: value if in_environment else value.lstrip() for name, value in values.items()}
    passed = {"MANIFEST": b"toy", "PRESET": b"draft", "WORKERS": b"0"} | passed
    expected = [b"run", b"sample-surfaces"]
    for name in PASSED:
        option = f"--{name.lower()}".encode()
        if name == "SET":
            expected += [word for word_of_value in passed.get(name, b"").split() for word in (option, word_of_value)]
        elif passed.get(name) or name not in OPTIONAL:
            expected += [option, passed[name]]
    return [*expected, b"--shard", b"0"]


def _without_shards(call: list[bytes]) -> list[bytes]:
    return call[:-4] + call[-2:] if call[-4:-3] == [b"--shards"] and 1 <= int(call[-3]) <= 9999 else call
