"""`make faults` and `make fuzz` with a few cases of each; findings are reported."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from checks.faults.__main__ import TEMPORARY, _page
from checks.faults.sandbox import Sandbox
from checks.faults.trial import Verdict, follow
from checks.fuzz.__main__ import fuzz
from checks.fuzz.target import Files, Target
from checks.fuzz.targets import TARGETS

ROOT = Path(__file__).parents[2]
KINDS = ("kill −9 of a run", "limit on the size of files", "damaged row that waits to be published")


@pytest.mark.slow
def test_dataset_survives_a_few_faults():
    command = [sys.executable, "-m", "checks.faults", "--share", "0", "--only", *KINDS]
    completed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert f"| all | {len(KINDS)} |" in completed.stdout


def test_page_counts_what_is_left_among_temporary_files():
    page = _page({"SIGTERM": [Verdict("", "equal digests")], TEMPORARY: [Verdict("", fault_of_ours="left behind: other/ (empty)")]}, 60, [])
    assert "| temporary files after all of these | 1 |  | 1 |" in page


def test_follow_applies_the_remedy_of_a_message(tmp_path):
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


@pytest.mark.slow
def test_a_few_mutated_files_give_clear_errors():
    command = [sys.executable, "-m", "checks.fuzz", "--inputs", "25"]
    completed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert completed.stdout.count(" inputs: ") == len(TARGETS)


class Careless(Target):
    """A target that raises an unexpected error."""

    def sound(self) -> list[Files]:
        return [{"number.txt": b"12345678"}]

    def read(self, folder: Path, files: Files) -> None:
        int((folder / "number.txt").read_bytes())


def test_finding_is_reported_with_its_files(tmp_path, monkeypatch):
    monkeypatch.setitem(TARGETS, "careless", (Careless, 1.0))
    tally = fuzz("careless", 50, seed=0, lanes=1, keep=tmp_path)
    assert tally.outcomes.total() == 50
    assert tally.outcomes["found"]
    ((where, message),) = tally.findings.items()
    assert where.startswith("ValueError at test_faults.py")
    assert "invalid literal" in message
    assert list(tmp_path.glob("careless/*/number.txt"))


def test_input_that_takes_too_much_memory_is_reported(tmp_path, monkeypatch):
    monkeypatch.setitem(TARGETS, "careless", (Careless, 1.0))
    monkeypatch.setattr("checks.fuzz.__main__.PEAK", 1.0)
    tally = fuzz("careless", 5, seed=0, lanes=1, keep=tmp_path)
    assert any(where.startswith("memory: ") for where in tally.findings)
    assert tally.largest > 1e6
