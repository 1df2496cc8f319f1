"""`make faults` and `make fuzz`, a few of each: nothing is lost, wrong or silent, and every finding would be told."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.faults.sandbox import Sandbox
from tests.faults.trial import follow
from tests.fuzz.__main__ import fuzz
from tests.fuzz.target import Files, Target
from tests.fuzz.targets import TARGETS

ROOT = Path(__file__).parents[2]
KINDS = ("kill −9 of a run",)


def test_a_few_faults_are_survived():
    command = [sys.executable, "-m", "tests.faults", "--share", "0", "--only", *KINDS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"| all | {len(KINDS)} |" in done.stdout


def test_what_a_message_says_is_done(tmp_path):
    record = tmp_path / "0000-of-0001.json"
    record.write_text("{}")
    assert follow(f"error: {record}: the record is damaged (no checksum);\ndelete it and run its stage again")
    assert not record.exists()
    described = tmp_path / "dataset.json"
    assert follow(f'error: {described} is damaged; write {{"shards": N}} into it, N as the records are named: 4')
    assert json.loads(described.read_text()) == {"shards": 4}
    assert not follow("error: run again")


def test_every_stage_of_the_sandbox_has_an_output(tmp_path):
    sandbox = Sandbox(tmp_path)
    assert len({sandbox.output(stage) for stage in sandbox.stages}) == len(sandbox.stages)


def test_a_few_wrong_files_are_refused_in_words():
    command = [sys.executable, "-m", "tests.fuzz", "--inputs", "50"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(" inputs: ") == len(TARGETS)


class Careless(Target):
    """Raises what nobody is meant to raise, and dies."""

    def sound(self) -> list[Files]:
        return [{"number.txt": b"12345678"}]

    def read(self, folder: Path, files: Files) -> None:
        int((folder / "number.txt").read_bytes())


def test_a_finding_is_told_with_its_files(tmp_path, monkeypatch):
    monkeypatch.setitem(TARGETS, "careless", (Careless, 1.0))
    tally = fuzz("careless", 50, seed=0, lanes=1, keep=tmp_path)
    assert tally.outcomes.total() == 50
    assert tally.outcomes["found"]
    ((where, told),) = tally.findings.items()
    assert where.startswith("ValueError at test_faults.py")
    assert "invalid literal" in told
    assert list(tmp_path.glob("careless/*/number.txt"))


def test_an_input_that_takes_too_much_memory_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(TARGETS, "careless", (Careless, 1.0))
    monkeypatch.setattr("tests.fuzz.__main__.PEAK", 1.0)
    tally = fuzz("careless", 5, seed=0, lanes=1, keep=tmp_path)
    assert any(where.startswith("memory: ") for where in tally.findings)
    assert tally.largest > 1e6
