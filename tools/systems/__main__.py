"""Install and run this project on other systems from nothing, as its README says, and say which are green (`make test-systems`).

Run as `python -m tools.systems [SYSTEM…]`, as root where a system is a Debian. What is tested is the last commit, in a clone. Exits with
status 1 if a command failed, or if systems made different datasets.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO

from benchmarks.provenance import ROOT, provenance
from pipeline.console import errors, print_line
from pipeline.errors import StageError
from tools.systems import wheel
from tools.systems.debian import MIRROR, USER, make_debian, network_variables

DEBIANS = {"debian-12": "bookworm", "debian-13": "trixie", "debian-testing": "testing"}  # the last has Python 3.14 and a newer Mesa
PYTHONS = ("python-3.11", "python-3.12", "python-3.13")
DEFAULT = ("debian-12", "debian-13", "python-3.12", "wheel")
README = ("make dataset", "make test")
"""The commands of README.md's quick start that show whether a new machine works."""
ARTIFACTS = ("surfaces", "grasps", "vision", "touch")
BEGIN, END = "<!-- Written by `make test-systems` -->\n", "<!-- End of what `make test-systems` writes -->\n"
LACKING = re.compile(r"^ +sudo (apt-get install -y .*)$", re.MULTILINE)
"""The command that `make` prints for users who are not root."""

Run = Callable[[str, IO[str]], int]
"""Runs a shell command on a system, where the clone is; writes what it prints, returns its exit status."""


@dataclass
class Row:
    """One line of the table."""

    system: str
    user: str
    python: str = ""
    minutes: list[float | None] = field(default_factory=list)
    digests: dict[str, str] = field(default_factory=dict)

    def cells(self) -> list[str]:
        """Write the line's cells."""
        minutes = ["failed" if spent is None else f"{spent:.1f}" for spent in self.minutes]
        return [self.system, self.python, self.user, *minutes, " ".join(digest[:8] for digest in self.digests.values()) or "–"]


def try_commands(row: Row, commands: list[str], run: Run, log_file: Path, as_root: Run | None = None) -> None:
    """Run commands until one fails, and fill in the row's minutes; `as_root` runs what `make` says that root has to install."""
    with log_file.open("w") as log:
        for command in commands:
            began, printed = time.monotonic(), len(log_file.read_bytes())
            status = run(command, log)
            if status and as_root and (lacking := LACKING.findall(log_file.read_bytes()[printed:].decode())):
                status = as_root(f"DEBIAN_FRONTEND=noninteractive {lacking[-1]}", log) or run(command, log)
            row.minutes.append(None if status else (time.monotonic() - began) / 60)
            if status:
                print_line(f"{row.system}, {row.user}: `{command}` failed; see {log_file}")
                break
    row.minutes += [None] * (len(commands) - len(row.minutes))


def examine(row: Row, run: Run, clone: Path, venv: str = ".venv") -> None:
    """Fill in the row's Python and the digests of the last dataset below `data` of the folder `clone`, as seen from here."""
    printed = clone / "printed"

    def ask(command: str) -> str:
        with printed.open("w") as log:
            return printed.read_text() if run(command, log) == 0 else ""

    programs = f"{shlex.quote(venv)}/bin"
    row.python = ask(f"{programs}/python -c 'import platform; print(platform.python_version())'").strip()
    for dataset in sorted(clone.glob("data/**/dataset.json")):
        accounts = json.loads(ask(f"{programs}/vt-pipeline status --json {shlex.quote(str(dataset.parent.relative_to(clone)))}") or "{}")
        row.digests = {name: accounts[name]["digest"] for name in ARTIFACTS if name in accounts}


def clone_into(folder: Path) -> Path:
    """Clone the last commit."""
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", f"file://{ROOT}", folder], check=True)
    return folder


def run_here(command: str, log: IO[str], folder: Path) -> int:
    """Run a shell command in a folder of this machine, with no environment variables but those for reaching registries."""
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ} | network_variables()
    process = subprocess.run(
        command, shell=True, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, check=False
    )
    return process.returncode


def try_debian(name: str, user: str, arguments: argparse.Namespace) -> Row:
    """Run the commands in a fresh Debian, as root or as another user."""
    row = Row(name.replace("-", " ").title(), "root" if user == "root" else "not root")
    system = make_debian(
        arguments.folder / name, arguments.folder / f"{name}-{user}", DEBIANS[name], mirror=arguments.mirror, binds=arguments.bind
    )
    inside = "/root/vt-pipeline" if user == "root" else f"/home/{USER}/vt-pipeline"
    clone = clone_into(system.root / inside[1:])

    def run(command: str, log: IO[str], *, user: str = user) -> int:
        return system.run(command, log=log, user=user, folder=inside)

    with (arguments.folder / f"{name}-{user}-packages.log").open("w") as log:
        run(f"apt-get update && chown -R {user}: .", log, user="root")
    try_commands(
        row, arguments.commands, run, arguments.folder / f"{name}-{user}.log", None if user == "root" else partial(run, user="root")
    )
    examine(row, run, clone)
    return row


def try_python(name: str, arguments: argparse.Namespace) -> Row:
    """Run the commands on this system with another Python: one on the path, of pyenv, or of uv."""
    row = Row("this machine", "root" if os.geteuid() == 0 else "not root")
    clone = clone_into(arguments.folder / name)
    version, (first_command, *other_commands) = name.removeprefix("python-"), arguments.commands
    of_pyenv = sorted(Path("~/.pyenv/versions").expanduser().glob(f"{version}.*/bin/python"))
    python = next(map(str, of_pyenv), None) or shutil.which(f"python{version}")  # pyenv's programs on the path run chosen versions alone
    create = f"{shlex.quote(python)} -m venv .venv" if python else f"uv venv --quiet --seed --python {version} .venv"
    run = partial(run_here, folder=clone)
    try_commands(row, [f"{create} && {first_command}", *other_commands], run, arguments.folder / f"{name}.log")
    examine(row, run, clone)
    return row


def try_environment(venv: str, arguments: argparse.Namespace) -> Row:
    """Run the commands in this checkout with an existing virtual environment, and separate data."""
    venv = os.path.abspath(venv)
    row = Row(Path(venv).name, "root" if os.geteuid() == 0 else "not root")
    folder = arguments.folder / f"{Path(venv).name}-data"
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "data").mkdir(parents=True)
    commands = [f"{command} VENV={shlex.quote(venv)} DATA={shlex.quote(str(folder / 'data'))}" for command in arguments.commands]
    try_commands(row, commands, partial(run_here, folder=ROOT), arguments.folder / f"{Path(venv).name}.log")
    examine(row, partial(run_here, folder=folder), folder, venv)
    return row


def try_wheel(arguments: argparse.Namespace) -> Row:
    """Build the wheel, install it into an empty environment, and run what `wheel.COMMANDS` names in an empty folder."""
    row = Row("the wheel, outside a clone", "root" if os.geteuid() == 0 else "not root")
    folder = arguments.folder / "wheel"
    clone = clone_into(folder.with_suffix(".clone"))
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "two-meshes.yaml").write_text(wheel.MANIFEST)
    venv, source = f"{shlex.quote(sys.executable)} -m venv .venv", shlex.quote(str(clone))
    pip = ".venv/bin/python -m pip --quiet --disable-pip-version-check"
    install = f"{venv} && {pip} wheel --no-deps -w . {source} && {pip} install -c {source}/constraints.txt *.whl"
    commands = [shlex.join([".venv/bin/vt-pipeline", *command]) for command in wheel.COMMANDS]
    commands += [f".venv/bin/python -c {shlex.quote(wheel.LIBRARY)}"]
    commands += [shlex.join([".venv/bin/vt-pipeline", *command]) for command in wheel.LATER]
    commands += [f"test -s {name}" for name in wheel.WRITTEN]
    run = partial(run_here, folder=folder)
    steps = [install, " && ".join(commands)]
    try_commands(row, steps if len(arguments.commands) > 1 else [" && ".join(steps)], run, arguments.folder / "wheel.log")
    row.minutes += [None] * (len(arguments.commands) - 2)
    examine(row, run, folder)
    row.digests = {}  # of other objects
    return row


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    names = [*DEBIANS, *PYTHONS, "wheel"]
    parser = argparse.ArgumentParser(prog="python -m tools.systems", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("systems", nargs="*", default=DEFAULT, metavar="SYSTEM", help=f"{', '.join(names)}, or a virtual environment")
    parser.add_argument("--command", action="append", dest="commands", help=f"run this instead of {' and '.join(README)}")
    parser.add_argument("--user", action="append", choices=["root", USER], dest="users", help="who runs it on a Debian; by default both")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "systems", help="where systems and logs are kept")
    parser.add_argument("--bind", type=Path, action="append", default=[], help="a folder that a Debian sees too, as pip may need")
    parser.add_argument("--mirror", default=MIRROR, help="where Debian's packages come from")
    parser.add_argument("--write", type=Path, help="a page whose table between markers is replaced")
    arguments = parser.parse_args(words)
    for name in arguments.systems:
        if name not in names and not (Path(name) / "pyvenv.cfg").exists():
            parser.error(f"there is no system {name}: there are {', '.join(names)}, and folders of virtual environments")
    arguments.commands = arguments.commands or list(README)
    arguments.folder = arguments.folder.absolute()
    return arguments


def try_all(arguments: argparse.Namespace) -> list[Row]:
    """Run the commands on every system that is asked for."""
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in arguments.systems:
        if name in DEBIANS:
            rows += [try_debian(name, user, arguments) for user in arguments.users or ("root", USER)]
        elif name in PYTHONS:
            rows.append(try_python(name, arguments))
        else:
            rows.append(try_wheel(arguments) if name == "wheel" else try_environment(name, arguments))
    return rows


def table(rows: list[Row], commands: list[str]) -> list[str]:
    """Write the table as lines of Markdown."""
    head = ["system", "Python", "user", *(f"`{command}`, min" for command in commands), f"digests of {', '.join(ARTIFACTS)}"]
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *(row.cells() for row in rows))]


def write_table(page: Path, lines: list[str]) -> None:
    """Replace what is between the page's markers."""
    before, _, rest = page.read_text().partition(BEGIN)
    _, marker, after = rest.partition(END)
    if not marker:
        raise StageError(f"{page} has no lines {BEGIN.strip()} and {END.strip()}")
    page.write_text(f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n\n{END}{after}")


def main() -> None:
    """Run what the command line asks for."""
    arguments = parse()
    try:
        rows = try_all(arguments)
        lines = table(rows, arguments.commands)
        measured = provenance("make test-systems", "python -m tools.systems")
        lines += ["", f"`{measured['command']}`, commit {measured['commit']}, {measured['machine']}, {measured['date']}."]
        for line in lines:
            print_line(line)
        if arguments.write:
            write_table(arguments.write, lines)
    except StageError as error:
        errors.print(f"error: {error}", markup=False)
        sys.exit(1)
    different = {tuple(row.digests.items()) for row in rows if row.digests}
    if len(different) > 1:
        errors.print("error: the systems made different datasets")
    sys.exit(len(different) > 1 or any(None in row.minutes for row in rows))


if __name__ == "__main__":
    main()
