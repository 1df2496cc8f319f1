"""One fault: a copy of the dataset, the injection, and the verdict on the result."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from checks.faults.sandbox import Sandbox, digests, remove
from checks.forked import IN_WORDS, OK, End, answer, run
from pipeline.store.validate import problems_below
from stages.registry import GRASP_STAGES

ATTEMPTS = 6
"""Runs within which following the messages must have repaired the dataset."""


@dataclass(frozen=True)
class Verdict:
    """Result of one fault: `outcome` if all is well in the end, `fault_of_ours` if not."""

    what: str
    outcome: str = ""
    fault_of_ours: str = ""

    def line(self) -> str:
        """Return the verdict as JSON for the process that collects verdicts."""
        return json.dumps(asdict(self))


@dataclass
class Trial:
    """Arguments of a fault: `whole` is the undisturbed dataset, `expected` its digests, `seconds` the duration of each stage."""

    sandbox: Sandbox
    whole: Path
    expected: dict[str, str]
    seconds: dict[str, float]
    folder: Path
    rng: np.random.Generator

    @property
    def data(self) -> Path:
        """Return the path of the copy."""
        return self.folder / "data"

    @property
    def log(self) -> Path:
        """Return the path of the output of the latest run."""
        return self.folder / "log"

    def copy(self, without: str | None = None) -> None:
        """Copy the dataset without the outputs of this stage and later ones."""
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.whole, self.data)
        later = list(GRASP_STAGES)[list(GRASP_STAGES).index(without) :] if without else []
        remove(self.data, [self.sandbox.output(stage) for stage in later])

    def copy_without_a_stage(self) -> str:
        """Draw a stage and copy the dataset without the outputs of it and later ones; return the stage."""
        stage = str(self.rng.choice(list(GRASP_STAGES)))
        self.copy(without=stage)
        return stage

    def run(self, work: Callable[[], object]) -> End:
        """Run a function in a separate process."""
        return run(work, self.log)

    def mended(
        self, what: str, first: End, *, stages: tuple[str, ...] = tuple(GRASP_STAGES), check: bool = False, retry: bool = False
    ) -> Verdict:
        """Follow the messages until all is well; return the verdict."""
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
        """Return the verdict on a dataset that must equal the undisturbed one."""
        try:
            digests_of_copy, problems = answer(lambda: (digests(self.data), problems_in(self.data)), self.log)
        except RuntimeError as error:
            return Verdict(what, fault_of_ours=f"cannot be read in the end: {error}")
        wrong = [name for name in sorted(names) if digests_of_copy.get(name) != self.expected[name]]
        if wrong:
            return Verdict(what, fault_of_ours=f"{did}other digests of {', '.join(wrong)}")
        if problems:
            return Verdict(what, fault_of_ours=f"{did}validate: {problems[0]}")
        if leftovers := self.left_over():
            return Verdict(what, fault_of_ours=f"{did}left behind: {', '.join(leftovers[:3])}")
        return Verdict(what, outcome=f"{did}equal digests")

    def left_over(self) -> list[str]:
        """List files of the work area except locks, and unfinished files."""
        work = [path for path in (self.data / ".work").rglob("*") if path.is_file() and path.suffix != ".lock" and path.name != "lock"]
        return [str(path.relative_to(self.data)) for path in [*work, *self.data.rglob("*.tmp")]]


def problems_in(data: Path) -> list[str]:
    """List the problems that `validate` reports."""
    return [line for lines in problems_below(data).values() for line in lines]


def follow(message: str) -> bool:
    """Apply the remedy of an error if it is more than to run again; return whether it is."""
    text = " ".join(message.split())
    if match := re.search(r"error: (\S+): the record is .*?delete", text):
        record = Path(match[1])
        record.rmdir() if record.is_dir() else record.unlink()
    elif match := re.search(r"Is a directory: '\S+' -> '(\S+)'", text):
        Path(match[1]).rmdir()
    elif match := re.search(r"error: (\S+dataset\.json) .*?write \{\"shards\": N\} into it, N as the records are named: (\d+)", text):
        description = Path(match[1])
        if description.is_dir():
            description.rmdir()
        else:
            description.unlink(missing_ok=True)  # it may be a pipe
        description.write_text(json.dumps({"shards": int(match[2])}))
    else:
        return False
    return True
