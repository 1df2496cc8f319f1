"""Runs that are killed, interrupted, short of disk space or memory, or concurrent."""

import os
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path

from checks.faults.trial import Trial, Verdict
from checks.forked import HANGS, IN_WORDS, OK, End, finish, fork
from pipeline.cli import app
from stages.registry import GRASP_STAGES

MEGABYTE = 2**20


def killed(trial: Trial) -> Verdict:
    """Kill a stage with SIGKILL at a random moment."""
    stage = trial.copy_without_a_stage()
    moment = trial.rng.uniform(0, trial.seconds[stage])
    process = fork(lambda: trial.sandbox.only(stage).make(trial.data), trial.log)
    time.sleep(moment)
    os.kill(process, signal.SIGKILL)
    end = finish(process, trial.log)
    return trial.mended(f"{stage} after {moment:.2f} s", _as_meant(end, -signal.SIGKILL), stages=(stage,))


def worker_killed(trial: Trial) -> Verdict:
    """Kill a worker with SIGKILL at a random moment; the run continues."""
    stage = str(trial.rng.choice([name for name in GRASP_STAGES if "train" not in name and name != "evaluate"]))
    trial.copy(without=stage)
    process = fork(lambda: trial.sandbox.only(stage).make(trial.data, workers=2), trial.log)
    began = time.monotonic()
    while not (workers := _workers(process)) and time.monotonic() - began < 30:
        time.sleep(0.01)
    moment = trial.rng.uniform(0, 5.0 + trial.seconds[stage])  # a worker takes seconds to start
    time.sleep(moment)
    for worker in (_workers(process) or workers)[:1]:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    return trial.mended(f"{stage}, a worker after {moment:.2f} s", finish(process, trial.log), stages=(stage,))


def terminated(trial: Trial) -> Verdict:
    """Send SIGTERM to the command at a random moment."""
    return _signalled(trial, signal.SIGTERM, "terminated")


def interrupted(trial: Trial) -> Verdict:
    """Send SIGINT to the command and its workers at a random moment, as a terminal does for Ctrl-C."""
    return _signalled(trial, signal.SIGINT, "interrupted")


def _signalled(trial: Trial, number: signal.Signals, word: str) -> Verdict:
    stage = trial.copy_without_a_stage()
    moment = trial.rng.uniform(0.3, 3.0 + trial.seconds[stage])
    process = fork(lambda: app(trial.sandbox.command(stage, trial.data)), trial.log)
    time.sleep(moment)
    os.killpg(process, number)
    end = finish(process, trial.log)
    what = f"{stage} after {moment:.2f} s"
    if end.status == -number:  # the signal came before the command began or after it ended
        end = End(OK, end.output)
    if end.status not in (OK, 128 + number) or "Traceback" in end.output or (end.status and word not in end.output):
        return Verdict(what, fault_of_ours=f"{word}: status {end.status}: {end.output.strip()[-600:]}")
    return trial.mended(what, _as_meant(end, 128 + number), stages=(stage,))


def file_too_large(trial: Trial) -> Verdict:
    """Limit the size of files, as a quota does, to 1 to 100 kB."""
    stage = trial.copy_without_a_stage()
    limit = int(10 ** trial.rng.uniform(3, 5))

    def work() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        trial.sandbox.only(stage).make(trial.data)

    return trial.mended(f"{stage}, files of {limit} bytes", trial.run(work), stages=(stage,))


def disk_full(trial: Trial) -> Verdict:
    """Leave 4 kB to 1 MB on the disk."""
    stage = trial.copy_without_a_stage()
    room = int(trial.rng.uniform(4096, MEGABYTE))
    with _disk(trial) as disk:
        disk.resize(_size(trial.data) + room)
        first = trial.run(lambda: trial.sandbox.only(stage).make(trial.data))
        disk.resize(100 * MEGABYTE)
        return trial.mended(f"{stage}, {room} bytes left", first, stages=(stage,))


def read_only(trial: Trial) -> Verdict:
    """Mount the disk read-only at a random moment."""
    stage = trial.copy_without_a_stage()
    moment = trial.rng.uniform(0, trial.seconds[stage])
    with _disk(trial) as disk:
        process = fork(lambda: trial.sandbox.only(stage).make(trial.data), trial.log)
        time.sleep(moment)
        while subprocess.run(["mount", "-o", "remount,ro", disk.path], capture_output=True, check=False).returncode:
            time.sleep(0.002)  # refused while a file is open for writing
            if os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                break
        first = finish(process, trial.log)
        disk.resize(100 * MEGABYTE)
        return trial.mended(f"{stage} after {moment:.2f} s", first, stages=(stage,))


def two_at_once(trial: Trial) -> Verdict:
    """Run the same stage twice, the second from a random moment of the first."""
    stage = trial.copy_without_a_stage()
    moment = trial.rng.uniform(0, trial.seconds[stage])
    other = trial.folder / "other-log"
    first = fork(lambda: trial.sandbox.only(stage).make(trial.data), trial.log)
    time.sleep(moment)
    second = finish(fork(lambda: trial.sandbox.only(stage).make(trial.data), other), other)
    end = finish(first, trial.log)
    worst = max((end, second), key=lambda end_of_run: (end_of_run.status not in (OK, IN_WORDS), end_of_run.status))
    return trial.mended(f"{stage}, {moment:.2f} s apart", worst, stages=(stage,))


def clock_jumps(trial: Trial) -> Verdict:
    """Set the clock wrong by up to ten years and let it jump while the stage runs."""
    stage = trial.copy_without_a_stage()
    right = time.time
    jumps = trial.rng.uniform(-3e8, 3e8, 1000)

    def work() -> None:
        time.time = lambda: right() + jumps[int(right() * 10) % len(jumps)]
        trial.sandbox.only(stage).make(trial.data)

    return trial.mended(f"{stage}, by {jumps[0] / 3.15e7:+.1f} years", trial.run(work), stages=(stage,))


def short_of_memory(trial: Trial) -> Verdict:
    """Limit memory to 1 to 400 MB above the process's use at its start."""
    stage = trial.copy_without_a_stage()
    more = int(trial.rng.uniform(1, 400)) * MEGABYTE

    def work() -> None:
        import_module("scipy.linalg")  # and with it OpenBLAS, which reports no lack of memory while it is loaded
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + more
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        trial.sandbox.only(stage).make(trial.data)

    end = trial.run(work)
    reported = end.status not in (OK, HANGS)  # an error, a traceback of an allocation or a crash: all are visible to the caller
    return trial.mended(f"{stage}, {more // MEGABYTE} MB more", End(IN_WORDS, end.output) if reported else end, stages=(stage,), retry=True)


def _as_meant(end: End, status: int) -> End:
    """Accept a process that ended with this status, or had finished before."""
    return End(OK, end.output) if end.status in (status, OK) else end


def _workers(process: int) -> list[int]:
    """List the worker processes of a run."""
    workers = []
    with suppress(OSError):  # the run or a worker may have ended
        for thread in Path(f"/proc/{process}/task").iterdir():
            for child in (thread / "children").read_text().split():
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    workers.append(int(child))
    return workers


class _Disk:
    """A separate disk in memory; mounting it needs root."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def resize(self, size: int) -> None:
        pages = -(-size // 4096) * 4096
        subprocess.run(["mount", "-o", f"remount,rw,size={pages}", str(self.path)], check=True)


@contextmanager
def _disk(trial: Trial) -> Iterator[_Disk]:
    """Move the copy to a separate disk."""
    kept = trial.folder.with_name(trial.folder.name + "-kept")
    shutil.rmtree(kept, ignore_errors=True)
    trial.data.rename(kept)
    trial.data.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=100m", "tmpfs", str(trial.data)], check=True)
    try:
        shutil.copytree(kept, trial.data, dirs_exist_ok=True)
        yield _Disk(trial.data)
    finally:
        subprocess.run(["umount", "-l", str(trial.data)], check=True)
        shutil.rmtree(kept)


def can_mount(folder: Path) -> bool:
    """Return whether this process may mount disks."""
    mount = folder / "mount"
    mount.mkdir(parents=True, exist_ok=True)
    mounted = (
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(mount)], capture_output=True, check=False).returncode == 0
    )
    return mounted and subprocess.run(["umount", str(mount)], check=False).returncode == 0


def _size(folder: Path) -> int:
    """Compute the bytes that a tmpfs needs for a folder."""
    return sum(-(-path.stat().st_size // 4096) * 4096 for path in folder.rglob("*") if path.is_file())
