"""Jobs and submissions of the shipped cluster file, for tests."""

from pathlib import Path

from pipeline.cluster.slurm_jobs import ClusterProfile, Job, Submission, load_cluster, plan_jobs
from stages.registry import STAGES, load_stage, resolve

SHIPPED = load_cluster("slurm")


def plan(*stages: str, assignments: tuple[str, ...] = ()) -> dict[str, Job]:
    jobs = plan_jobs((load_stage(name), resolve(name, "draft", assignments)) for name in STAGES if name in stages)
    return {job.name: job for job in jobs}


def submission(folder: Path, profile: ClusterProfile = SHIPPED, arguments: tuple[str, ...] = (), shards: int = 3) -> Submission:
    return Submission(profile, arguments, shards, folder / ".work/slurm", folder)
