"""`vt-pipeline submit`: stages as jobs of a Slurm cluster."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.completion import complete_described, complete_stage
from pipeline.cli.request import (
    DataOption,
    ManifestOption,
    ObjectsOption,
    PresetOption,
    SeedOption,
    SetOption,
    UnitsOption,
    UpOption,
)
from pipeline.cluster import slurm
from pipeline.cluster.slurm_jobs import Submission, load_cluster, plan_jobs, script_of
from pipeline.console import print_line
from pipeline.store.directory import DataDirectory
from stages.registry import STAGES, make_request


def submit(
    stages: Annotated[list[str], typer.Argument(help=f"One or more of {', '.join(STAGES)}.", autocompletion=complete_stage)],
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: ObjectsOption = None,
    units: UnitsOption = None,
    up: UpOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    shards: Annotated[int | None, typer.Option(min=1, max=9999, help="Tasks per stage; by default the dataset's shards, or 1.")] = None,
    cluster: Annotated[
        str,
        typer.Option(
            help="A built-in cluster, or the path of a YAML file: partitions, cores, times.", autocompletion=complete_described("cluster")
        ),
    ] = "slurm",
    dry_run: Annotated[bool, typer.Option(help="Print the scripts, and submit nothing.")] = False,
) -> None:
    """Run stages as jobs of a Slurm cluster.

    Each object stage is an array with one task per shard, and each job waits for those whose outputs it reads.
    """
    options: dict[str, Any] = {"data": data, "objects": objects, "assignments": assignments or (), "seed": seed, "units": units, "up": up}
    ordered = sorted(stages, key=lambda name: list(STAGES).index(name) if name in STAGES else -1)
    requests = [make_request(name, manifest, preset, **options) for name in dict.fromkeys(ordered)]
    where = requests[0].data
    arguments = ["--manifest", manifest, "--preset", preset, "--data", str(where)]
    arguments += ["--objects", str(objects)] if objects else []
    named = {"--units": units, "--up": up, "--seed": seed}
    arguments += [part for option, value in named.items() if value is not None for part in (option, str(value))]
    submission = Submission(
        profile=load_cluster(cluster),
        arguments=(*arguments, *(part for assignment in assignments or () for part in ("--set", assignment))),
        shards=DataDirectory(where).check_shard_count(shards),
        folder=slurm.slurm_folder(where).absolute(),
        start=Path.cwd(),
    )
    jobs = plan_jobs((request.stage, request.settings) for request in requests)
    if dry_run:
        for job in jobs:
            print_line(f"# {job.name}" + (f", after {', '.join(job.waits_for)}" if job.waits_for else ""))
            typer.echo(script_of(job, submission))
        return
    for submitted in slurm.submit(jobs, submission):
        print_line(f"{submitted.name}: job {submitted.number}" + (f", {submitted.tasks} tasks" if submitted.tasks else ""))
    print_line(f"`vt-pipeline status {shlex.quote(str(where))}` shows their states; scripts and logs are in {submission.folder}")
