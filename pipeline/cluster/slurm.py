"""Submit jobs to Slurm, and find their states: from `squeue`, from `sacct` if there is one, and from files that tasks leave."""

import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from pipeline.cluster.slurm_jobs import Job, Submission, dependency, script_of
from pipeline.console import pluralise
from pipeline.errors import StageError, StoreError, first_line
from pipeline.store.atomic import exclusive_lock, write_atomically
from pipeline.store.directory import DataDirectory
from pipeline.store.record import Stored
from pipeline.store.storage import Location, on_disk, read_bytes

State = Literal["pending", "running", "done", "failed", "unknown"]

PENDING = {"PENDING", "REQUEUED", "REQUEUE_FED", "REQUEUE_HOLD", "SPECIAL_EXIT"}
ENDED = {"BOOT_FAIL", "CANCELLED", "DEADLINE", "FAILED", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED", "REVOKED", "TIMEOUT"}
SECONDS = 60
"""Time limit for an answer of Slurm, which may be under load."""


class SubmittedJob(Stored):
    """A submitted job: its number, and how many tasks it has; None if it is no array."""

    stage: str
    output: str
    name: str
    number: str = Field(pattern=r"^[0-9]+$")
    tasks: int | None = Field(ge=1, le=9999)

    @property
    def task_names(self) -> list[str]:
        """The names of its tasks in Slurm: 12_0, 12_1, …; 12 if the job is no array."""
        return [self.number] if self.tasks is None else [f"{self.number}_{index}" for index in range(self.tasks)]

    def log(self, folder: Path, task: str) -> Path:
        """Return the path of a task's log."""
        return folder / f"{self.name}-{task}.log"


class _SubmittedJobs(Stored):
    """The file that lists submitted jobs, the last one per output."""

    jobs: tuple[SubmittedJob, ...] = ()


@dataclass(frozen=True)
class TaskState:
    """The state of a task: `why` it waits, failed or is unknown; `log` is the file of its output."""

    task: str
    state: State
    why: str
    log: Path


@dataclass(frozen=True)
class JobState:
    """The states of a job's tasks."""

    job: SubmittedJob
    tasks: tuple[TaskState, ...]


def slurm_folder(data: Location) -> Path:
    """Return the folder of scripts, logs, exit statuses and the list of jobs: with the data, or the current folder for object storage."""
    folder = DataDirectory(data).work("slurm")
    return on_disk(folder) or Path("slurm", *str(data).split("://"))


def submit(jobs: Sequence[Job], submission: Submission) -> Iterator[SubmittedJob]:
    """Write the scripts of all jobs, then submit one after the other, each to start after those that it reads from."""
    folder = submission.folder
    if not shutil.which("sbatch"):
        raise StageError("sbatch is not installed here; submit on a machine of the cluster, or print the scripts with --dry-run")
    scripts = {job.output: script_of(job, submission) for job in jobs}
    with exclusive_lock(folder / "lock", folder):
        jobs_by_output = {job.output: job for job in submitted_jobs(folder)}
        _refuse_unfinished(states_of(folder, [jobs_by_output[output] for output in scripts if output in jobs_by_output]))
        ids: dict[str, str] = {}
        for job in jobs:
            path = folder / f"{job.name}.sh"
            write_atomically(path, os.fsencode(scripts[job.output]))  # a path among its arguments may not be valid text
            ids[job.output] = _sbatch(path, dependency(job, {other.output: other for other in jobs}, ids), list(ids.values()))
            tasks = submission.shards if job.is_array else None
            submitted = SubmittedJob(stage=job.stage.name, output=job.output, name=job.name, number=ids[job.output], tasks=tasks)
            jobs_by_output[job.output] = submitted
            write_atomically(folder / "jobs.json", _SubmittedJobs(jobs=tuple(jobs_by_output.values())).model_dump_json(indent=1).encode())
            yield submitted


def _refuse_unfinished(states: Iterable[JobState]) -> None:
    for state in states:
        if waiting := sum(task.state in ("pending", "running") for task in state.tasks):
            raise StageError(
                f"{state.job.output} is being made: job {state.job.number} has {pluralise(waiting, 'task')} not ended yet; wait for it, "
                f"or end it with `scancel {state.job.number}`"
            )


def _sbatch(script: Path, condition: str | None, earlier_ids: list[str]) -> str:
    """Submit a script; return the job's number."""
    options = [f"--dependency={condition}"] if condition else []
    completed = _run_command("sbatch", "--parsable", *options, str(script))
    number = completed.stdout.strip().partition(";")[0]
    if completed.returncode or not number.isdigit():
        remedy = f"; `scancel {' '.join(earlier_ids)}` ends what was submitted before it" if earlier_ids else ""
        raise StageError(
            f"sbatch refuses {script}: {_error_line(completed)}. Partition, memory, time and options are those of the "
            f"cluster file (--cluster), the array has a task per shard{remedy}"
        )
    return number


def submitted_jobs(folder: Path) -> tuple[SubmittedJob, ...]:
    """Read the list of jobs; raise a `StoreError` if it is damaged."""
    path = folder / "jobs.json"
    try:
        return _SubmittedJobs.model_validate_json(read_bytes(path)).jobs
    except FileNotFoundError:
        return ()
    except (OSError, ValidationError) as error:
        raise StoreError(f"{path} is damaged ({first_line(error)}); delete it: only `status` and `submit` read it") from error


def states_of(folder: Path, jobs: Sequence[SubmittedJob]) -> list[JobState]:
    """Find the state of every task of some jobs.

    Slurm forgets a job some minutes after its end; then the task's exit status counts, or Slurm's accounting.
    """
    if not jobs:
        return []
    states, no_answer = _squeue(jobs)
    forgotten = [job for job in jobs if any(task not in states for task in job.task_names)]
    accounts = _sacct(forgotten) if forgotten else {}
    return [JobState(job, tuple(_state_of(folder, job, task, accounts | states, no_answer) for task in job.task_names)) for job in jobs]


def jobs_account(data: Location) -> dict[str, dict[str, Any]]:
    """Describe the jobs that make a data directory, by output: name, number, and by task its state and why it waits or failed."""
    folder = slurm_folder(data)
    return {
        state.job.output: state.job.model_dump()
        | {
            "states": {task.task: task.state for task in state.tasks},
            "why": {task.task: task.why + (f"; see {task.log}" if _has_failed_log(task) else "") for task in state.tasks},
        }
        for state in states_of(folder, submitted_jobs(folder))
    }


def _has_failed_log(task: TaskState) -> bool:
    return task.state == "failed" and task.log.exists()


def _state_of(folder: Path, job: SubmittedJob, task: str, states: dict[str, tuple[str, str]], no_answer: str) -> TaskState:
    name, reason = states.get(task, ("", ""))
    reason = "" if reason == "None" else reason
    status = _exit_status(folder / f"{task}.exit")
    state: State = "failed"
    if name in PENDING:
        state, why = "pending", reason
    elif name in ENDED:
        why = f"{name} ({reason})" if reason else name
    elif name and name != "COMPLETED":
        state, why = "running", reason
    elif status == 0 or (name and status is None):
        state, why = "done", ""
    elif status is not None:
        why = f"exit status {status}"
    elif no_answer:
        state, why = "unknown", no_answer
    else:
        why = "it was ended before it was finished" if job.log(folder, task).exists() else "it was cancelled before it began"
    return TaskState(task, state, why, job.log(folder, task))


def _exit_status(path: Path) -> int | None:
    """Read the exit status that a task left; None if it left none."""
    try:
        return int(read_bytes(path))
    except (OSError, ValueError):
        return None


def _squeue(jobs: Sequence[SubmittedJob]) -> tuple[dict[str, tuple[str, str]], str]:
    """Ask `squeue` for state and reason of every task that it has not forgotten; also return why it does not answer, if so."""
    numbers = ",".join(job.number for job in jobs)
    completed = _run_command("squeue", "--noheader", "--array", "--states=all", f"--jobs={numbers}", "--format=%F|%K|%T|%r")
    if completed.returncode and "Invalid job id" not in completed.stderr:
        return {}, f"squeue does not answer: {_error_line(completed)}"
    rows = (line.strip().split("|", 3) for line in completed.stdout.splitlines() if line.count("|") >= 3)
    return {number if index == "N/A" else f"{number}_{index}": (state, reason) for number, index, state, reason in rows}, ""


def _sacct(jobs: Sequence[SubmittedJob]) -> dict[str, tuple[str, str]]:
    """Ask `sacct` for the state of every task that it knows; empty if there is no accounting."""
    numbers = ",".join(job.number for job in jobs)
    completed = _run_command("sacct", "--noheader", "--allocations", "--parsable2", f"--jobs={numbers}", "--format=JobID,State")
    rows = (line.strip().split("|", 1) for line in completed.stdout.splitlines() if "|" in line and not completed.returncode)
    return {task: (state.split()[0], "") for task, state in rows if state}


def _error_line(completed: subprocess.CompletedProcess[str]) -> str:
    """Return the first line of a failed command's output."""
    return next(iter((completed.stderr or completed.stdout).splitlines()), f"status {completed.returncode}").rstrip(".")


def _run_command(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run one of Slurm's commands; if it cannot be run, return a failure with the reason."""
    try:
        return subprocess.run([program, *arguments], capture_output=True, text=True, check=False, timeout=SECONDS)
    except FileNotFoundError:
        return subprocess.CompletedProcess(program, 127, "", f"{program} is not installed here")
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(program, 124, "", f"{program} has not answered for {SECONDS} s")
