"""`python -m tools.systems` runs commands on other systems and writes a table of them; `make test-systems` makes the systems."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import IO

import pytest

from benchmarks.provenance import ROOT
from pipeline.errors import StageError
from tools.systems import debian
from tools.systems.__main__ import BEGIN, END, Row, examine, parse, run_here, table, try_commands, write_table


def test_commands_run_until_one_fails(tmp_path):
    row = Row("a system", "root")

    def run(command: str, log: IO[str]) -> int:
        return run_here(command, log, tmp_path)

    try_commands(row, ["touch a", "false", "touch b"], run, tmp_path / "log")
    assert [spent is None for spent in row.minutes] == [False, True, True]
    assert (tmp_path / "a").exists()
    assert not (tmp_path / "b").exists()
    assert row.cells()[4:6] == ["failed", "failed"]


def test_root_installs_the_packages_that_make_names_and_the_user_continues(tmp_path):
    install = (ROOT / "tools" / "install.sh").read_text()
    (said,) = [line.split('"')[1] for line in install.splitlines() if "sudo apt-get" in line]
    asked: list[str] = []

    def run(command: str, log: IO[str]) -> int:
        print(said.replace("$missing", " libegl1 python3-venv"), file=log, flush=True)
        return 0 if asked else 1

    def as_root(command: str, log: IO[str]) -> int:
        asked.append(command)
        return 0

    row = Row("a system", "not root")
    try_commands(row, ["make dataset"], run, tmp_path / "log", as_root)
    assert asked == ["DEBIAN_FRONTEND=noninteractive apt-get install -y libegl1 python3-venv"]
    assert None not in row.minutes


def test_root_is_not_asked_again_when_a_later_command_fails(tmp_path):
    asked: list[str] = []

    def run(command: str, log: IO[str]) -> int:
        if command == "make dataset" and not asked:
            print("    sudo apt-get install -y libegl1", file=log, flush=True)
        return 1 if command == "make test" else 1 - len(asked)

    def as_root(command: str, log: IO[str]) -> int:
        asked.append(command)
        return 0

    try_commands(Row("a system", "not root"), ["make dataset", "make test"], run, tmp_path / "log", as_root)
    assert len(asked) == 1


def test_python_and_digests_are_read_from_the_clone(tmp_path):
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    accounts = {name: {"digest": name[0] * 64} for name in ("grasps", "surfaces", "models/unet")}
    for name, printed in (("python", "3.12.1"), ("vt-pipeline", json.dumps(accounts))):
        program = tmp_path / ".venv" / "bin" / name
        program.write_text(f"#!/bin/sh\necho '{printed}'\n")
        program.chmod(0o755)
    (tmp_path / "data" / "toy" / "draft").mkdir(parents=True)
    (tmp_path / "data" / "toy" / "draft" / "dataset.json").touch()
    row = Row("a system", "root")
    examine(row, lambda command, log: run_here(command, log, tmp_path), tmp_path)
    assert row.cells() == ["a system", "3.12.1", "root", "ssssssss gggggggg"]


def test_table_replaces_the_previous_one(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}old\n{END}after\n")
    lines = table([Row("Debian 13", "root", "3.13.5", [1.25])], ["make dataset"])
    for _ in range(2):
        write_table(page, lines)
    assert page.read_text() == f"before\n{BEGIN}\n" + "\n".join(lines) + f"\n\n{END}after\n"
    assert lines[2] == "| Debian 13 | 3.13.5 | root | 1.2 | – |"
    assert BEGIN in (ROOT / "docs" / "guide" / "installing.md").read_text()
    with pytest.raises(StageError, match="has no lines"):
        write_table(Path(__file__), lines)


def test_unknown_system_is_refused_with_the_list_of_systems(capsys):
    with pytest.raises(SystemExit):
        parse(["debian-99"])
    assert "there is no system debian-99: there are debian-12, debian-13, debian-testing, python-3.11" in capsys.readouterr().err


def test_debian_systems_need_debootstrap(monkeypatch, tmp_path):
    monkeypatch.setattr(debian.shutil, "which", lambda name: None)
    with pytest.raises(StageError, match="apt-get install debootstrap"):
        debian.make_debian(tmp_path / "base", tmp_path / "root", "trixie")


def test_script_that_enters_a_debian_is_valid_shell(tmp_path):
    assert subprocess.run(["sh", "-n", "-c", debian.ENTER], check=False).returncode == 0
