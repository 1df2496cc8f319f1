"""`python -m checks.faults [--share 0.1] [--seed N] [--write FILE]`: inject faults, and print what became of them.

Ends with status 1 if anything was lost, wrong or silent.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
import torch

from benchmarks.provenance import provenance
from checks.faults import changes, damage, interruptions, links
from checks.faults.sandbox import Sandbox, digests
from checks.faults.trial import Trial, Verdict
from checks.forked import OK, answer, finish, fork, run
from pipeline.store.temporary import private_folder, temporary_folder
from stages.registry import GRASP_STAGES

Fault = Callable[[Trial], Verdict]

FAULTS: dict[str, tuple[Fault, int]] = {
    "kill −9 of a run": (interruptions.killed, 130),
    "kill −9 of a worker": (interruptions.worker_killed, 20),
    "SIGTERM": (interruptions.terminated, 15),
    "Ctrl-C": (interruptions.interrupted, 15),
    "disk full": (interruptions.disk_full, 20),
    "disk read-only": (interruptions.read_only, 10),
    "limit on the size of files": (interruptions.file_too_large, 20),
    "two runs at once": (interruptions.two_at_once, 20),
    "clock that jumps": (interruptions.clock_jumps, 15),
    "limit on memory": (interruptions.short_of_memory, 20),
    "damaged file of a dataset": (damage.damaged, 180),
    "damaged row that waits to be published": (damage.row_damaged, 20),
    "record of another version": (changes.version_changed, 15),
    "hand, sensor or mesh changed in place": (changes.description_changed, 10),
    "symbolic link in a dataset": (links.linked, 20),
    "symbolic link in a report": (links.report_linked, 6),
    "socket or device in place of a file": (links.irregular, 40),
    "reader open while it is made with other settings": (links.open_while_made_again, 12),
}
"""Each fault and the number of its injections."""

NEEDS_MOUNT = ("disk full", "disk read-only")

CACHE = "inductor"
"""Folder that torch keeps among temporary files for all runs."""

TEMPORARY = "temporary files after all of these"
"""Name of the row for what the runs left among temporary files."""

INTRODUCTION = """# Faults

The command below wrote this page. Each fault hits a copy of a small dataset (three objects, the stages from `sample-surfaces` to
`evaluate`) at a random moment or place. Then the stages run again, and the remedy of each message is followed. A fault passes if every
digest equals the undisturbed dataset's, `validate` finds nothing, and nothing is left in the work area. [Reliability](reliability.md)
lists the guarantees.
"""


def main() -> None:
    """Inject the faults and print the table."""
    parser = argparse.ArgumentParser(prog="python -m checks.faults", description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="of the faults of each kind; at least one is injected")
    parser.add_argument("--only", nargs="+", choices=list(FAULTS), default=list(FAULTS), help="these kinds alone")
    parser.add_argument("--seed", type=int, default=0, help="draws moments and places")
    parser.add_argument("--lanes", type=int, default=len(os.sched_getaffinity(0)), help="faults side by side")
    parser.add_argument("--write", type=Path, help="put the table there too")
    chosen = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        verdicts = inject(Path(folder), chosen.only, chosen.share, chosen.seed, chosen.lanes)
    page = _page(verdicts, time.monotonic() - began, [kind for kind in chosen.only if kind not in verdicts])
    print(page)
    if chosen.write:
        chosen.write.write_text(page, encoding="utf-8")
    sys.exit(any(verdict.fault_of_ours for verdicts_of_kind in verdicts.values() for verdict in verdicts_of_kind))


def inject(root: Path, kinds: Sequence[str], share: float, seed: int, lanes: int) -> dict[str, list[Verdict]]:
    """Make the undisturbed dataset, then inject faults into copies of it; return the verdicts by kind."""
    torch.set_num_threads(1)
    temporary = root / "tmp"
    temporary.mkdir()
    os.environ["TMPDIR"] = tempfile.tempdir = str(temporary)
    sandbox = Sandbox(root)
    sandbox.prepare()
    whole, seconds = root / "whole", {}
    for stage in GRASP_STAGES:
        began = time.monotonic()
        end = run(lambda name=stage: sandbox.only(name).make(whole), root / "log")
        assert end.status == OK, end.output
        seconds[stage] = time.monotonic() - began
    shutil.rmtree(whole / ".work", ignore_errors=True)
    possible = [kind for kind in kinds if kind not in NEEDS_MOUNT or interruptions.can_mount(root)]
    faults = [(kind, number) for kind in possible for number in range(max(1, round(share * FAULTS[kind][1])))]
    expected = answer(lambda: digests(whole), root / "log")
    logs = [root / f"lane-{lane}.log" for lane in range(lanes)]
    processes, progress = [], os.fdopen(os.dup(sys.stderr.fileno()), "w", buffering=1)  # the output of a lane goes to its log
    for lane, log in enumerate(logs):
        trial = Trial(sandbox, whole, expected, seconds, root / f"lane-{lane}", np.random.default_rng(0))
        processes.append(fork(lambda lane=lane, trial=trial: _lane(faults[lane::lanes], trial, seed, progress), log))
    for process, log in zip(processes, logs, strict=True):
        end = finish(process, log, limit=10_000)
        assert end.status == OK, end.output
    verdicts: dict[str, list[Verdict]] = {kind: [] for kind in possible}
    for line in (line for log in logs for line in log.read_text().splitlines() if line.startswith("{")):
        result = json.loads(line)
        verdicts[result["kind"]].append(Verdict(**result["verdict"]))
    with temporary_folder():  # removes the folders of killed runs, as the next run does
        private = private_folder()
    leftovers = [path for folder in (temporary, private) for path in folder.iterdir() if path != private]
    if leftovers := [_described(path) for path in leftovers if CACHE not in path.name and not _of_ctypes(path)]:
        left_behind = Verdict("temporary folder", fault_of_ours=f"left behind: {', '.join(leftovers[:5])}")
        print(f"{left_behind.what}: {left_behind.fault_of_ours}", file=progress)
        verdicts[TEMPORARY] = [left_behind]
    return verdicts


def _of_ctypes(path: Path) -> bool:
    """Return whether a file is the `tmp????????` into which `ctypes.util.find_library` lets gcc link; a kill leaves it.

    It is empty, or the start of an ELF file.
    """
    return path.match("tmp????????") and path.is_file() and path.read_bytes()[:4] in (b"", b"\0\0\0\0", b"\x7fELF")


def _described(path: Path) -> str:
    """Describe a leftover, to find out who left it."""
    if path.is_dir():
        return f"{path.name}/ ({', '.join(sorted(inner.name for inner in path.iterdir())[:3]) or 'empty'})"
    return f"{path.name} ({path.stat().st_size} bytes, starts with {path.read_bytes()[:8]!r})"


def _lane(faults: Sequence[tuple[str, int]], trial: Trial, seed: int, progress: TextIO) -> None:
    """Inject faults one after the other; the seed of each follows from its kind and number."""
    for done, (kind, number) in enumerate(faults):
        if not done or faults[done - 1][0] != kind:
            print(f"{done} of {len(faults)} faults of this process done, next: {kind}", file=progress)
        trial.rng = np.random.default_rng([seed, number, *kind.encode()])
        try:
            verdict = FAULTS[kind][0](trial)
        except Exception as error:
            verdict = Verdict(f"number {number}", fault_of_ours=f"the harness: {type(error).__name__}: {error}")
        if verdict.fault_of_ours:
            print(f"{kind}: {verdict.what}: {verdict.fault_of_ours}", file=progress)
        print(json.dumps({"kind": kind, "verdict": vars(verdict)}), flush=True)


def _page(verdicts: dict[str, list[Verdict]], seconds: float, missing: Sequence[str]) -> str:
    """Write the table; `missing` are kinds that could not be injected."""
    outcomes = sorted({verdict.outcome for verdicts_of_kind in verdicts.values() for verdict in verdicts_of_kind if verdict.outcome})
    rows = []
    for kind, verdicts_of_kind in verdicts.items():
        counts = Counter(verdict.outcome for verdict in verdicts_of_kind)
        rows.append(
            [
                kind,
                len(verdicts_of_kind),
                *(counts[outcome] or "" for outcome in outcomes),
                sum(bool(verdict.fault_of_ours) for verdict in verdicts_of_kind),
            ]
        )
    rows.append(["all", *(sum(row[column] or 0 for row in rows) for column in range(1, len(rows[0])))])
    header = ["fault", "injected", *outcomes, "lost, wrong or silent"]
    table = [header, ["---"] * len(header), *rows]
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in table]
    about = provenance("make faults", "python -m checks.faults")
    heading = f"`{about['command']}`, commit {about['commit']}, {about['date']}, {about['machine']}:"
    note = f"\nNot injected, for want of the right to mount a disk: {', '.join(missing)}.\n" if missing else ""
    return "\n".join([INTRODUCTION, heading, f"{seconds / 60:.0f} minutes.\n", *lines, note])


if __name__ == "__main__":
    main()
