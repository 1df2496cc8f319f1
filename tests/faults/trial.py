"""One fault: a copy of the dataset, what is done to it, and the verdict on what became of it."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.store.validate import problems_below
from stages.registry import GRASP_STAGES
from tests.faults.sandbox import Sandbox, digests, remove
from tests.forked import IN_WORDS, OK, End, answer, run

ATTEMPTS = 6
"""Runs within which what a message says to do must have mended the dataset."""


@dataclass(frozen=True)
class Verdict:
    """What became of one fault: `outcome` where all is well in the end, `fault_of_ours` where it is not."""

    what: str
    outcome: str = ""
    fault_of_ours: str = ""

    def line(self) -> str:
        """As JSON, for the process that gathers them."""
        return json.dumps(asdict(self))


@dataclass
class Trial:
    """What a fault is given: `whole` is the undisturbed dataset, `expected` its digests, `seconds` what each stage took."""

    sandbox: Sandbox
    whole: Path
    expected: dict[str, str]
    seconds: dict[str, float]
    folder: Path
    rng: np.random.Generator

    @property
    def data(self) -> Path:
        """The copy."""
        return self.folder / "data"

    @property
    def log(self) -> Path:
        """What the latest run printed."""
        return self.folder / "log"

    def copy(self, without: str | None = None) -> None:
        """Copy the dataset, but for what this stage and those after it made."""
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.whole, self.data)
        later = list(GRASP_STAGES)[list(GRASP_STAGES).index(without) :] if without else []
        remove(self.data, [self.sandbox.output(stage) for stage in later])

    def copy_without_a_stage(self) -> str:
        """Draw a stage, and copy the dataset but for what it and those after it made; the stage."""
        stage = str(self.rng.choice(list(GRASP_STAGES)))
        self.copy(without=stage)
        return stage

    def run(self, work: Callable[[], object]) -> End:
        """Run a function in a process of its own."""
        return run(work, self.log)

    def mended(
        self, what: str, first: End, *, stages: tuple[str, ...] = tuple(GRASP_STAGES), check: bool = False, retry: bool = False
    ) -> Verdict:
        """Do as the messages say until all is well; the verdict on it."""
        if first.status not in (OK, IN_WORDS):
            return Verdict(what, fault_of_ours=f"ended with status {first.status}: {first.output.strip()[-600:]}")
        did = "error in words; " if first.status == IN_WORDS else ""
        sandbox = self.sandbox.only(*stages)
        for attempt in range(ATTEMPTS):
            end = self.run(partial(sandbox.make, self.data, check=check, retry=retry or attempt > 0))
            if end.status == OK:
                break
            if end.status != IN_WORDS:
                return Verdict(what, fault_of_ours=f"run again: status {end.status}: {end.output.strip()[-600:]}")
            did = "error in words; "
            if follow(end.output):
                did = "error in words, its remedy followed; "
        else:
            return Verdict(what, fault_of_ours=f"not mended in {ATTEMPTS} runs: {end.output.strip()[-600:]}")
        return self.compared(what, did, {sandbox.output(stage) for stage in stages})

    def compared(self, what: str, did: str, names: set[str]) -> Verdict:
        """Judge a dataset that must be the same as without the fault."""
        try:
            found, problems = answer(lambda: (digests(self.data), problems_in(self.data)), self.log)
        except RuntimeError as error:
            return Verdict(what, fault_of_ours=f"cannot be read in the end: {error}")
        wrong = [name for name in sorted(names) if found.get(name) != self.expected[name]]
        if wrong:
            return Verdict(what, fault_of_ours=f"{did}other digests of {', '.join(wrong)}")
        if problems:
            return Verdict(what, fault_of_ours=f"{did}validate: {problems[0]}")
        if left := self.left_over():
            return Verdict(what, fault_of_ours=f"{did}left behind: {', '.join(left[:3])}")
        return Verdict(what, outcome=f"{did}equal digests")

    def left_over(self) -> list[str]:
        """Files of the work area that are no locks, and files that were never finished."""
        work = [path for path in (self.data / ".work").rglob("*") if path.is_file() and path.suffix != ".lock" and path.name != "lock"]
        return [str(path.relative_to(self.data)) for path in [*work, *self.data.rglob("*.tmp")]]


def problems_in(data: Path) -> list[str]:
    """List the problems that `validate` reports."""
    return [line for lines in problems_below(data).values() for line in lines]


def follow(message: str) -> bool:
    """Do what an error says, where that is more than to run again; whether it was."""
    text = " ".join(message.split())
    if found := re.search(r"error: (\S+): the record is .*?delete", text):
        record = Path(found[1])
        record.rmdir() if record.is_dir() else record.unlink()
    elif found := re.search(r"Is a directory: '\S+' -> '(\S+)'", text):
        Path(found[1]).rmdir()
    elif found := re.search(r"error: (\S+dataset\.json) .*?write \{\"shards\": N\} into it, N as the records are named: (\d+)", text):
        described = Path(found[1])
        if described.is_dir():
            described.rmdir()
        else:
            described.unlink(missing_ok=True)  # it may be a pipe
        described.write_text(json.dumps({"shards": int(found[2])}))
    else:
        return False
    return True
