"""`vt-pipeline run` and `vt-pipeline submit`: make the missing rows of a stage, here or as jobs of a Slurm cluster."""

import re
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from pipeline.cli import options
from pipeline.cli.options import of_objects, of_run
from pipeline.config.manifest import load_manifest
from pipeline.console import NAMED, abbreviate, console, print_lines, print_warning
from pipeline.engine.make import make, shard_numbers
from pipeline.engine.plan import Made
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from stages.registry import STAGES, make_request

complete_stage = options.complete(lambda: STAGES)


def run(
    stages: Annotated[list[str], Argument(help=f"One or more of {', '.join(STAGES)}.", autocompletion=complete_stage)],
    manifest: options.ManifestOption = "toy",
    preset: options.PresetOption = "draft",
    data: options.DataOption = None,
    objects: options.ObjectsOption = None,
    shard: Annotated[int | None, of_run(min=0, help="Only this shard of --shards.")] = None,
    shards: options.ShardsOption = None,
    executor: options.ExecutorOption = "processes",
    workers: options.WorkersOption = 0,
    scheduler: Annotated[str | None, of_run(help="Use the workers of this Dask scheduler, such as tls://HOST:8786.")] = None,
    object_id: Annotated[str | None, of_objects("--object", help="Make only this object.", autocompletion=options.complete_object)] = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
    assignments: options.SetOption = None,
    seed: options.SeedOption = None,
    strict: Annotated[bool, of_run(help="Stop at the first object that fails in this stage.")] = False,
    retry: Annotated[bool, of_run(help="Try objects again that failed in this stage.")] = False,
    check: Annotated[bool, of_run(help="Verify published rows first, and make damaged ones again.")] = False,
    reuse: Annotated[str | None, of_run(help="Copy rows with equal keys from this directory, e.g. of another number of shards.")] = None,
    dry_run: Annotated[bool, of_run(help="Print what a run would do, and do nothing.")] = False,
) -> None:
    """Run stages.

    Each begins when those before it are finished. Objects that are up to date are left alone; a run that was killed continues where it
    stopped.
    """
    processes = options.make_executor(executor, workers, scheduler)
    named: dict[str, Any] = {"data": data, "objects": objects, "assignments": assignments or (), "seed": seed, "units": units, "up": up}
    how: dict[str, Any] = {"shards": shards, "executor": processes, "strict": strict, "retry": retry, "check": check, "only": object_id}
    named["reuse"] = reuse and as_location(reuse)
    requests = [make_request(name, manifest, preset, **named, **how) for name in _in_order(stages)]
    if reuse:
        DataDirectory(reuse).check_exists()
    for request in requests:
        shard_numbers(request, shard)  # an error before the first stage runs
    for request in requests:
        print_lines(*([] if request.stage.inputs(request.settings) else load_manifest(manifest).remarks(objects)))
        print_lines(*request.stage.describe_objects(request.settings, request.objects))
        with processes:  # which end with a stage, and with them the libraries that it loaded
            make(request, console, shard, dry_run=dry_run, report=print_made)


def _in_order(stages: Iterable[str]) -> list[str]:
    """Sort stages so that each follows those that it may read; unknown ones come first, to be refused."""
    order = {name: number for number, name in enumerate(STAGES)}
    return sorted(dict.fromkeys(stages), key=lambda name: order.get(name, -1))


def print_made(made: Made) -> None:
    """Print what was made, or would be, and the objects that failed, grouped by reason."""
    print_lines(f"{made.stage} {made.path}: {made.text}", *made.notes)
    alike: dict[str, list[str]] = {}
    for object_id, failure in made.failures.items():
        alike.setdefault(re.sub(rf"^{re.escape(object_id)}\b", "…", failure.reason), []).append(object_id)
    for shared, names in alike.items():
        reason = shared if len(names) > 1 else made.failures[names[0]].reason
        listed = abbreviate(names) + (f" ({len(names)} objects)" if len(names) > NAMED else "")
        print_warning("  failed", f"{listed}: {reason}")


def submit(
    stages: Annotated[list[str], Argument(help=f"One or more of {', '.join(STAGES)}.", autocompletion=complete_stage)],
    manifest: options.ManifestOption = "toy",
    preset: options.PresetOption = "draft",
    data: options.DataOption = None,
    objects: options.ObjectsOption = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
    assignments: options.SetOption = None,
    seed: options.SeedOption = None,
    shards: Annotated[int | None, Option(min=1, max=9999, help="Tasks per stage; by default the dataset's shards, or 1.")] = None,
    cluster: Annotated[
        str,
        Option(
            help="Built-in cluster, or path of a YAML file: partitions, cores, times.", autocompletion=options.complete_described("cluster")
        ),
    ] = "slurm",
    dry_run: Annotated[bool, Option(help="Print the scripts, and submit nothing.")] = False,
) -> None:
    """Run stages as jobs of a Slurm cluster.

    Each object stage is an array with one task per shard, and each job waits for those whose outputs it reads.
    """
    from pipeline.cluster import slurm
    from pipeline.cluster.slurm_jobs import Submission, load_cluster, plan_jobs, script_of

    named: dict[str, Any] = {"data": data, "objects": objects, "assignments": assignments or (), "seed": seed, "units": units, "up": up}
    requests = [make_request(name, manifest, preset, **named) for name in _in_order(stages)]
    where = requests[0].data
    stated = {"manifest": manifest, "preset": preset, "data": where, "objects": objects, "units": units, "up": up, "seed": seed}
    arguments = [part for option, value in stated.items() if value is not None for part in (f"--{option}", str(value))]
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
            print_lines(f"# {job.name}" + (f", after {', '.join(job.waits_for)}" if job.waits_for else ""))
            typer.echo(script_of(job, submission))
        return
    for submitted in slurm.submit(jobs, submission):
        print_lines(f"{submitted.name}: job {submitted.number}" + (f", {submitted.tasks} tasks" if submitted.tasks else ""))
    print_lines(f"`vt-pipeline status {shlex.quote(str(where))}` shows their states; scripts and logs are in {submission.folder}")
