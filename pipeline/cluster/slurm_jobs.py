"""Plan a submission to Slurm: the cluster's description, one job per output, its dependencies and its script."""

import shlex
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError

from pipeline.config.settings import Settings
from pipeline.engine.stage import Stage
from pipeline.entries import Entries
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path, invalid_entries, read_description


def _require_text(value: Any) -> Any:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise ValueError(f"YAML reads it as the number {value}; write it in quotes and with its unit, as '04:00:00' or '16G'")
    return value


def _require_one_line(line: str) -> str:
    if not line.isprintable():
        raise ValueError(f"{line!r} is not one line of printable text, as a job's script needs; remove control characters and line breaks")
    return line


Line = Annotated[str, AfterValidator(_require_one_line)]
Word = Annotated[Line, Field(pattern=r"^[^\s,]+$")]
Number = Annotated[int, Field(ge=1, le=10**6)]


class Allocation(Entries):
    """The resources of one task: a partition, cores, memory and time, as `sbatch` takes them."""

    partition: Word
    cores: Number
    memory: Annotated[str, BeforeValidator(_require_text), Field(pattern=r"^[1-9][0-9]*[KMGT]$")]
    time: Annotated[str, BeforeValidator(_require_text), Field(pattern=r"^([0-9]+-)?[0-9]+(:[0-9]{2}){0,2}$")]


class GpuAllocation(Allocation):
    """An allocation with GPUs: how many, or their type and how many."""

    gpus: Number | Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+:[1-9][0-9]*$")] = 1


class ClusterProfile(Entries):
    """Describe a Slurm cluster."""

    name: Line
    summary: str = ""
    cpu: Allocation  # the resources of a task
    gpu: GpuAllocation | None = None  # those of stages that use a GPU, if the cluster has any
    # maximum number of tasks of one array that run at a time; None leaves it to the cluster
    concurrent: Number | None = None
    setup: tuple[Line, ...] = ()  # shell lines that every task runs first
    # how the nodes call vt-pipeline; None is the Python that submits, on a file system that the nodes share
    command: Line | None = None
    account: Word | None = None  # the account that is charged
    options: tuple[Annotated[Line, Field(pattern=r"^--[a-z][a-z-]*(=\S+)?$")], ...] = ()  # more options of `sbatch`


def load_cluster(name: str | Path) -> ClusterProfile:
    """Read a cluster by the name of a shipped file or by path; raise an `InvalidInput` that names the file and the fault."""
    return read_description("cluster", description_path("cluster", name), ClusterProfile)


SEED = "training_seed"  # the setting that trainings and their evaluation share


@dataclass(frozen=True)
class Job:
    """A job: an array with one task per shard, or the single task of a dataset stage."""

    stage: Stage
    settings: Settings  # what the stage runs with, assignments included
    assignments: tuple[str, ...] = ()  # the job's own --set options
    waits_for: tuple[str, ...] = ()  # outputs of other jobs that this one reads

    @property
    def output(self) -> str:
        """The artifact or folder that is made."""
        return self.stage.writes(self.settings)

    @property
    def is_array(self) -> bool:
        """Whether there is a task per shard."""
        return self.stage.per_object

    @property
    def name(self) -> str:
        """The job's name in Slurm and in `.work/slurm`."""
        return "-".join([self.stage.name, *(assignment.partition("=")[2] for assignment in self.assignments)])


@dataclass(frozen=True)
class Submission:
    """The parameters that all jobs of a submission share."""

    profile: ClusterProfile
    arguments: tuple[str, ...]  # of `vt-pipeline run STAGE`, without shards and workers
    shards: int
    folder: Path  # of scripts, logs and exit statuses
    start: Path


def plan_jobs(stages: Iterable[tuple[Stage, Settings]]) -> list[Job]:
    """Plan the jobs of stages, given in the order of the pipeline, from what each reads and writes.

    A stage whose folder is named by one of its settings gets a job per folder that the other stages read: one `train-gcn` per
    configuration that `evaluate` is asked for, with its training seed.
    """
    requested = list(stages)
    models_read = [(model, dict(settings).get(SEED)) for stage, settings in requested for model in stage.models(settings)]
    jobs = []
    for stage, settings in requested:
        variants = [job for folder, seed in models_read if (job := _job_for(stage, settings, folder, seed))]
        jobs += variants or [Job(stage, settings)]
    outputs = {job.output for job in jobs}
    return [replace(job, waits_for=tuple(name for name in job.stage.reads(job.settings) if name in outputs)) for job in jobs]


def _job_for(stage: Stage, settings: Settings, folder: str, seed: int | None) -> Job | None:
    """Find the job in which a stage writes this folder, if necessary with another value of the setting that names it, and another seed."""
    changes: dict[str, Any] = {SEED: seed} if seed is not None and dict(settings).get(SEED, seed) != seed else {}
    if (changed := _changed(stage, settings, changes)) is None:
        return None
    output, value = stage.writes(changed), Path(folder).name
    if output != folder:
        name = next((name for name, current in changed if current == Path(output).name), None)
        if name is None or Path(output).parent != Path(folder).parent:
            return None
        changes = {name: value} | changes
        if (changed := _changed(stage, settings, changes)) is None:
            return None
    return Job(stage, changed, tuple(f"{stage.name}.{name}={value}" for name, value in changes.items()))


def _changed(stage: Stage, settings: Settings, changes: dict[str, Any]) -> Settings | None:
    """Change settings; return None where one of the changed ones takes no such value: `train-single-image` makes no `models/unet`."""
    try:
        return type(settings).model_validate(dict(settings) | changes)
    except ValidationError as error:
        if all(item["loc"] and item["loc"][0] in changes for item in error.errors()):
            return None
        raise InvalidInput(
            f"{stage.name} with {', '.join(f'{name}={value}' for name, value in changes.items())}: {invalid_entries(error)}"
        ) from error


def dependency(
    job: Job,
    jobs: Mapping[str, Job],  # all, by output
    ids: Mapping[str, str],  # Slurm's numbers of the jobs that it waits for, by output
) -> str | None:
    """Return a job's `--dependency` option of `sbatch`; None if it waits for no other job.

    A task of an array waits for the task of the same shard; whatever involves a dataset stage waits for whole jobs.
    """
    shardwise = [ids[name] for name in job.waits_for if job.is_array and jobs[name].is_array]
    whole_jobs = [ids[name] for name in job.waits_for if not (job.is_array and jobs[name].is_array)]
    conditions = [":".join([kind, *job_ids]) for kind, job_ids in (("aftercorr", shardwise), ("afterok", whole_jobs)) if job_ids]
    return ",".join(conditions) or None


def script_of(job: Job, submission: Submission) -> str:
    """Write the script of a job; refuse a folder with a name that no script can hold."""
    profile, folder = submission.profile, submission.folder
    for path in (folder, submission.start):
        if not str(path).isprintable():
            raise InvalidInput(f"{str(path)!r} has characters that a job's script cannot hold; rename the folder")
    uses_gpu = dict(job.settings).get("accelerator", "cpu") != "cpu"
    allocation = profile.gpu if uses_gpu and profile.gpu else profile.cpu
    assignments = [part for assignment in job.assignments for part in ("--set", assignment)]
    arguments = ["run", job.stage.name, *submission.arguments, *assignments, "--workers", str(allocation.cores)]
    arguments += ["--shards", str(submission.shards)] if job.is_array else []
    command = f"{profile.command or shlex.join([sys.executable, '-m', 'pipeline'])} {shlex.join(arguments)}"
    pattern = str(folder).replace("%", "%%")
    limit = f"%{profile.concurrent}" if profile.concurrent else ""
    options = {
        "job-name": job.name,
        "chdir": str(submission.start),
        "output": f"{pattern}/{job.name}-{'%A_%a' if job.is_array else '%j'}.log",
        "open-mode": "append",
        "partition": allocation.partition,
        "ntasks": "1",
        "cpus-per-task": str(allocation.cores),
        "mem": allocation.memory,
        "time": allocation.time,
        **({"gres": f"gpu:{allocation.gpus}"} if isinstance(allocation, GpuAllocation) else {}),
        **({"array": f"0-{submission.shards - 1}{limit}"} if job.is_array else {}),
        **({"account": profile.account} if profile.account else {}),
        "kill-on-invalid-dep": "yes",
    }
    lines = [f"--{name}={shlex.quote(value)}" for name, value in options.items()] + ["--requeue", *profile.options]
    task = "${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}" if job.is_array else "${SLURM_JOB_ID}"
    return "\n".join(
        [
            "#!/bin/bash",
            *(f"#SBATCH {line}" for line in lines),
            "",
            f'left={shlex.quote(str(folder))}/"{task}.exit"',
            'rm -f "$left"',
            "(",
            "set -e",
            *profile.setup,
            command + (' --shard "$SLURM_ARRAY_TASK_ID"' if job.is_array else ""),
            ")",
            "status=$?",
            'echo "$status" > "$left"',
            'exit "$status"',
            "",
        ]
    )
