"""Submit jobs to Slurm, and find their states: from `squeue`, from `sacct` if there is one, and from files that tasks leave."""

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from pipeline.cluster.slurm_jobs import Job, Submission, dependency, script_of
from pipeline.entries import Entries
from pipeline.errors import StageError, StoreError, first_line
from pipeline.store.atomic import exclusive_lock, write_atomically
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location, on_disk, read_bytes

State = Literal["pending", "running", "done", "failed", "unknown"]

PENDING = {"PENDING", "REQUEUED", "REQUEUE_FED", "REQUEUE_HOLD", "SPECIAL_EXIT"}
ENDED = {"BOOT_FAIL", "CANCELLED", "DEADLINE", "FAILED", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED", "REVOKED", "TIMEOUT"}
SECONDS = 60  # time limit for an answer of Slurm, which may be under load


class SubmittedJob(Entries):
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


_JOBS = TypeAdapter(dict[Literal["jobs"], tuple[SubmittedJob, ...]])  # of the file that lists submitted jobs, the last one per output


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
        earlier = [jobs_by_output[output] for output in scripts if output in jobs_by_output]
        states = task_states(folder, earlier)
        for made in earlier:
            if waiting := sum(states[task][0] in ("pending", "running") for task in made.task_names):
                raise StageError(f"job {made.number} makes {made.output}, tasks left: {waiting}; wait, or `scancel {made.number}`")
        ids: dict[str, str] = {}
        for job in jobs:
            path = folder / f"{job.name}.sh"
            write_atomically(path, os.fsencode(scripts[job.output]))  # a path among its arguments may not be valid text
            ids[job.output] = _sbatch(path, dependency(job, {other.output: other for other in jobs}, ids), list(ids.values()))
            tasks = submission.shards if job.is_array else None
            submitted = SubmittedJob(stage=job.stage.name, output=job.output, name=job.name, number=ids[job.output], tasks=tasks)
            jobs_by_output[job.output] = submitted
            write_atomically(folder / "jobs.json", _JOBS.dump_json({"jobs": tuple(jobs_by_output.values())}, indent=1))
            yield submitted


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
        return _JOBS.validate_json(read_bytes(path))["jobs"]
    except FileNotFoundError:
        return ()
    except (OSError, ValidationError) as error:
        raise StoreError(f"{path} is damaged ({first_line(error)}); delete it: only `status` and `submit` read it") from error


def task_states(folder: Path, jobs: Sequence[SubmittedJob]) -> dict[str, tuple[State, str]]:
    """Find the state of every task of some jobs, and why it waits, failed or is unknown.

    Slurm forgets a job some minutes after its end; then the task's exit status counts, or Slurm's accounting.
    """
    if not jobs:
        return {}
    states, no_answer = _squeue(jobs)
    forgotten = [job for job in jobs if any(task not in states for task in job.task_names)]
    accounts = _sacct(forgotten) if forgotten else {}
    return {task: _state_of(folder, job, task, accounts | states, no_answer) for job in jobs for task in job.task_names}


def jobs_account(data: Location) -> dict[str, dict[str, Any]]:
    """Describe the jobs that make a data directory, by output: name, number, and by task its state and why it waits or failed."""
    folder = slurm_folder(data)
    jobs, account = submitted_jobs(folder), {}
    states = task_states(folder, jobs)
    for job in jobs:
        account[job.output] = job.model_dump() | {"states": {}, "why": {}}
        for task in job.task_names:
            state, why = states[task]
            log = job.log(folder, task)
            account[job.output]["states"][task] = state
            account[job.output]["why"][task] = f"{why}; see {log}" if state == "failed" and log.exists() else why
    return account


def _state_of(folder: Path, job: SubmittedJob, task: str, states: dict[str, tuple[str, str]], no_answer: str) -> tuple[State, str]:
    name, reason = states.get(task, ("", ""))
    reason = "" if reason == "None" else reason
    status = None
    with suppress(OSError, ValueError):  # it left none
        status = int(read_bytes(folder / f"{task}.exit"))
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
    return state, why


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
    return next(iter((completed.stderr or completed.stdout).splitlines()), f"status {completed.returncode}").rstrip(".")


def _run_command(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run one of Slurm's commands; if it cannot be run, return a failure with the reason."""
    try:
        return subprocess.run([program, *arguments], capture_output=True, text=True, check=False, timeout=SECONDS)
    except FileNotFoundError:
        return subprocess.CompletedProcess(program, 127, "", f"{program} is not installed here")
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(program, 124, "", f"{program} has not answered for {SECONDS} s")
