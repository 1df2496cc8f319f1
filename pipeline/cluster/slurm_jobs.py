"""Plan a submission to Slurm: one job per output, its dependencies and its script."""

import shlex
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pipeline.cluster.cluster_profile import Allocation, ClusterProfile, GpuAllocation
from pipeline.config.settings import Settings
from pipeline.engine.stage import Stage
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import invalid_entries

SEED = "training_seed"
"""The setting that trainings and their evaluation share."""


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
    allocation = allocation_of(job, profile)
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
            command_of(job, submission, allocation.cores),
            ")",
            "status=$?",
            'echo "$status" > "$left"',
            'exit "$status"',
            "",
        ]
    )


def command_of(job: Job, submission: Submission, cores: int) -> str:
    """Write the command of a job as the shell takes it."""
    program = submission.profile.command or shlex.join([sys.executable, "-m", "pipeline"])
    assignments = [part for assignment in job.assignments for part in ("--set", assignment)]
    arguments = ["run", job.stage.name, *submission.arguments, *assignments, "--workers", str(cores)]
    if not job.is_array:
        return f"{program} {shlex.join(arguments)}"
    return f'{program} {shlex.join([*arguments, "--shards", str(submission.shards)])} --shard "$SLURM_ARRAY_TASK_ID"'


def allocation_of(job: Job, profile: ClusterProfile) -> Allocation:
    """Select the resources of a task: with GPUs if its settings use one and the cluster has any."""
    uses_gpu = dict(job.settings).get("accelerator", "cpu") != "cpu"
    return profile.gpu if uses_gpu and profile.gpu else profile.cpu
