"""Find the provenance of figures: command, commit, machine, date."""

import datetime
import os
import platform
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = ("pipeline", "stages", "schemas", "benchmarks")
"""Folders that figures depend on."""


def provenance(default_command: str, program: str) -> dict[str, str]:
    """Collect the provenance of a measurement by this process: `program` with its arguments, or `default_command` if it has none."""
    command = shlex.join([*shlex.split(program), *sys.argv[1:]]) if sys.argv[1:] else default_command
    return {"command": command, "commit": commit(), "machine": machine(), "date": datetime.date.today().isoformat()}


def commit() -> str:
    """Find the checkout's short commit, with a note where sources differ from it."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", *SOURCES)
    return (git("rev-parse", "--short", "HEAD") or "unknown") + (" with changes" if changed else "")


def machine() -> str:
    """Describe processor, cores, system and Python."""
    path = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.*)$", path.read_text() if path.exists() else "", re.MULTILINE)
    model = [*names, platform.processor() or platform.machine()][0].strip()
    return f"{model}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"
