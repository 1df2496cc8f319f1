"""`python -m checks.fuzz [--inputs 1000000] [--only TARGET …] [--seed N]`: feed wrong files to whatever reads files.

Only errors in words are allowed: no other exception, no crash, nothing over `SECONDS`, `BYTES` or `PEAK`. Findings are printed with the
files that led to them, which are kept; ends with status 1 if there is one.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from checks.forked import finish, fork
from checks.fuzz.mutations import mutated
from checks.fuzz.target import Files, Target
from checks.fuzz.targets import TARGETS
from pipeline.errors import PipelineError
from pipeline.formats.mesh_reader import end_reader

SECONDS = 120
"""Limit per input: twice the processor time that reading a mesh may take, because the processor is shared."""

BYTES = 2 * 2**30
PEAK = 1.5e9
"""Bytes that an input may take in any process: `PEAK` of memory, `BYTES` of addresses, most of which are not backed."""

TREES = (".yaml", ".gltf", ".json")


@dataclass
class Tally:
    """Outcomes of the inputs of a target; `findings` maps where an error was raised to a folder of files."""

    outcomes: Counter[str] = field(default_factory=Counter)
    findings: dict[str, str] = field(default_factory=dict)
    slowest: float = 0.0
    largest: float = 0.0


class _TooSlow(BaseException):
    """An input took longer than `SECONDS`."""


def main() -> None:
    """Fuzz the targets and print the findings."""
    parser = argparse.ArgumentParser(prog="python -m checks.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="in all")
    parser.add_argument("--only", nargs="+", choices=list(TARGETS), default=list(TARGETS), help="these targets alone")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lanes", type=int, default=len(os.sched_getaffinity(0)), help="processes side by side")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"), help="where the files of findings go")
    chosen = parser.parse_args()
    shares = {name: TARGETS[name][1] for name in chosen.only}
    has_findings = False
    for name, share in shares.items():
        tally = fuzz(name, round(chosen.inputs * share / sum(shares.values())), chosen.seed, chosen.lanes, chosen.keep)
        counts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(tally.outcomes.items()))
        peak = f"the slowest {tally.slowest:.2f} s, the largest process {tally.largest / 1e9:.2f} GB"
        print(f"{name}: {sum(tally.outcomes.values())} inputs: {counts}; {peak}", flush=True)
        for where, files in tally.findings.items():
            has_findings = True
            print(f"  FOUND {where}\n        {files}", flush=True)
    sys.exit(has_findings)


def fuzz(name: str, inputs: int, seed: int, lanes: int, keep: Path) -> Tally:
    """Feed mutated files to a target in separate processes; a process that dies is a finding and is replaced."""
    target = TARGETS[name][0]()
    whole = Tally()
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as root:
        remaining = {lane: (0, inputs // lanes + (lane < inputs % lanes)) for lane in range(lanes)}
        running = {lane: _start(target, Path(root), lane, seed, *remaining[lane], keep / name) for lane in remaining}
        while running:
            for lane, (process, log) in list(running.items()):
                end = finish(process, log, limit=100_000)
                parts = [json.loads(line) for line in end.output.splitlines() if line.startswith("{")]
                done = _add(whole, parts)
                del running[lane]
                if end.status:
                    folder = Path(root) / str(lane)
                    where = f"the process ended with {end.status}: {end.output.strip()[-200:]}"
                    whole.findings.setdefault(where, _keep(folder, keep / name))
                    whole.outcomes["crashed"] += 1
                    remaining[lane] = (remaining[lane][0] + done + 1, remaining[lane][1])
                    if remaining[lane][0] < remaining[lane][1]:
                        running[lane] = _start(target, Path(root), lane, seed, *remaining[lane], keep / name)
    return whole


def _start(target: Target, root: Path, lane: int, seed: int, first: int, stop: int, keep: Path) -> tuple[int, Path]:
    log = root / f"{lane}.log"
    return fork(lambda: _feed(target, root / str(lane), range(first, stop), f"{seed} {lane}", keep), log), log


def _feed(target: Target, folder: Path, numbers: range, seed: str, keep: Path) -> None:
    """Feed inputs one after the other and print the outcomes of each thousand."""
    signal.signal(signal.SIGALRM, _alarm)
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    tally, reported = Tally(), set[str]()
    for number in numbers:
        rng = random.Random(f"{seed} {number}")
        files = _mutated_files(target, rng)
        _write(folder, files)
        began = time.perf_counter()
        outcome = "accepted"
        try:
            with _deadline():
                target.read(folder, files)
        except PipelineError:
            outcome = "refused in words"
        except (Exception, _TooSlow) as error:
            outcome = "found"
            if (where := _where(error)) not in reported:
                reported.add(where)
                tally.findings[where] = f"{str(error)[:100]!r}, {_keep(folder, keep)}"
        if number == numbers[-1]:
            end_reader()  # memory of a child counts once it has ended
        if (peak := _peak()) > PEAK and "memory" not in reported:
            reported.add("memory")
            tally.findings[f"memory: {peak / 1e9:.2f} GB"] = _keep(folder, keep)
        tally.largest = max(tally.largest, peak)
        tally.outcomes[outcome] += 1
        tally.slowest = max(tally.slowest, time.perf_counter() - began)
        if number % 1000 == 999 or number == numbers[-1]:
            print(json.dumps(vars(tally)), flush=True)
            tally = Tally()


def _mutated_files(target: Target, rng: random.Random) -> Files:
    files = dict(rng.choice(target.seeds))
    others = [content for seed in target.seeds for content in seed.values()]
    for _ in range(rng.choice((1, 1, 1, 2))):
        name = rng.choice(list(files))
        files[name] = mutated(files[name], others, rng, tree=name.endswith(TREES))
    return files


def _write(folder: Path, files: Files) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _add(whole: Tally, parts: list[dict[str, object]]) -> int:
    """Add the outcomes that a process printed; return the number of their inputs."""
    before = whole.outcomes.total()
    for part in parts:
        whole.outcomes.update(part["outcomes"])  # type: ignore[arg-type]
        for where, files in part["findings"].items():  # type: ignore[attr-defined]
            whole.findings.setdefault(where, files)
        whole.slowest = max(whole.slowest, part["slowest"])  # type: ignore[type-var, assignment]
        whole.largest = max(whole.largest, part["largest"])  # type: ignore[type-var, assignment]
    return whole.outcomes.total() - before


def _keep(folder: Path, keep: Path) -> str:
    kept = keep / f"{time.time_ns():x}"
    shutil.copytree(folder, kept)
    return str(kept)


def _peak() -> float:
    """Return the peak memory, in bytes, of this process and of those that it waited for."""
    return 1024.0 * max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def _where(error: BaseException) -> str:
    last = traceback.extract_tb(error.__traceback__)
    ours = next((frame for frame in reversed(last) if "/pipeline/" in frame.filename or "/stages/" in frame.filename), last[-1])
    return f"{type(error).__name__} at {Path(ours.filename).name}:{ours.lineno} {ours.name}"


@contextmanager
def _deadline() -> Iterator[None]:
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)


def _alarm(number: int, frame: FrameType | None) -> None:
    raise _TooSlow


if __name__ == "__main__":
    main()
