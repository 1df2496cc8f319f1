"""`vt-pipeline advise`: which settings a time, or an error, allows."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from pipeline.cli.failures import fail
from pipeline.cli.request import ManifestOption, ObjectsOption, UnitsOption, UpOption
from pipeline.console import console, errors, print_line
from pipeline.tradeoff.advice import STAGES_OF, Question
from pipeline.tradeoff.advice import advise as advise_settings
from pipeline.tradeoff.choice import Limit, duration, error_limit


def advise(
    manifest: ManifestOption = "toy",
    target: Annotated[str, typer.Option("--for", help="dataset, or train: the data and the network with touch alone.")] = "dataset",
    budget: Annotated[str | None, typer.Option(help="Time for all of it, as 90s, 10min or 1.5h.")] = None,
    error: Annotated[
        str | None, typer.Option(help="Limit on a stage's error, as 5um, 2% or simulate-touch=1um: see docs/tradeoff.md.")
    ] = None,
    objects: ObjectsOption = None,
    units: UnitsOption = None,
    up: UpOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Advise settings for a time or for an error.

    With `--budget`: the most accurate within that time; with `--error`: the fastest within that error. A few of the manifest's objects are
    made first, so that times are those of this machine and these objects.
    """
    if target not in STAGES_OF:
        fail(f"--for {target}: it is {' or '.join(STAGES_OF)}")
    if budget is not None and error is None:
        goal: float | Limit = duration(budget)
    elif error is not None and budget is None:
        goal = error_limit(error)
    else:
        fail("give either --budget or --error")
    try:
        advice = advise_settings(Question(target, manifest, objects, goal, units, up), errors)
    except KeyboardInterrupt as stop:
        stop.args = ("what was tried out is removed",)
        raise
    if as_json:
        typer.echo(json.dumps(advice.as_json(), indent=2))
        return
    console.print(advice.table())
    for line in advice.sources():
        print_line(line)
    apart = " and what the contact sheets take" if target == "dataset" else ""
    print_line(f"{advice.objects} objects in about {advice.seconds / 60:.1f} min{apart}:")
    print_line(f"  {advice.command}")
