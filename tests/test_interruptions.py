"""Ctrl-C ends a command with one line and status 130 at any time."""

import os
import signal
import subprocess
import sys
import time

import pytest

from checks.forked import run
from pipeline.cli import app

STOPPED = "error: interrupted; run the same command again, what is finished is kept\n"

SWALLOWED = {
    "by a library": """
try:
    press()
except BaseException:
    pass
""",
    "into another error": """
try:
    press()
except BaseException:
    raise ImportError("no libEGL")
""",
    "in a destructor": """
class Freed:
    def __del__(self):
        press()
Freed()
""",
    "in a callback of C code": """
import ctypes
ctypes.CFUNCTYPE(None)(press)()
""",
}


def press() -> None:
    """Press Ctrl-C."""
    os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture
def command(monkeypatch, tmp_path):
    """Return a function that runs `vt-pipeline doctor` in a separate process with other code in place of its checks."""

    def run_body(body: str) -> tuple[int, str]:
        def examine():
            exec(body, {"press": press})
            time.sleep(60)

        monkeypatch.setattr("pipeline.checks.doctor.examine", examine)
        finished = run(lambda: app(["doctor"]), tmp_path / "log")
        return finished.status, finished.output

    return run_body


@pytest.mark.parametrize("body", SWALLOWED.values(), ids=SWALLOWED)
def test_swallowed_interrupt_still_ends_the_command(body, command):
    assert command(body) == (130, STOPPED)


def test_interrupt_is_raised_once_so_that_cleanup_finishes(command):
    result = command("""
import time
try:
    press()
finally:
    press()
    time.sleep(1.5)
    print("closed")
""")
    assert result == (130, f"closed\n{STOPPED}")


@pytest.mark.parametrize(("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")])
def test_command_stopped_during_imports_prints_one_line(number, word):
    program = f"""
import os, sys
class Stops:
    @staticmethod
    def find_spec(name, *_):
        if name == "pipeline.cli.app":
            os.kill(os.getpid(), {int(number)})
sys.meta_path.insert(0, Stops)
from pipeline.__main__ import main
main()
"""
    completed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (completed.returncode, completed.stdout, completed.stderr) == (128 + number, "", f"error: {word}\n")
