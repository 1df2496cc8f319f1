"""`vt-pipeline advise`: which settings a time, or an error, allows."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from pipeline.cli.messages import fail
from pipeline.cli.request import ManifestOption, ObjectsOption, failures_as_words, make_request
from pipeline.config.manifest import Object, load_manifest
from pipeline.config.presets import resolve
from pipeline.console import console, errors, say
from pipeline.engine.plan import Request
from pipeline.errors import AdviceError
from pipeline.tuning.advice import Choice, Pace, assignments, duration, error_limit, fastest, within_error, within_time
from pipeline.tuning.probe import probe, probe_training, some_of
from pipeline.tuning.tradeoff import Trade, load_trades
from stages.registry import STAGES, is_set_stage, load_stage

PRESET = "standard"
"""What is advised is said as changes to this preset."""
AIMS = {
    "dataset": ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch"),
    "train": ("sample-surfaces", "simulate-grasps", "simulate-touch", "train-unet", "fit-charts", "train-gcn"),
}
"""By target of make: the stages that settings are chosen for. What is trained is the network that only feels, and needs no image."""
FELT = "train-gcn.configuration=touch"
TRIED_AN_WORKER = 3
"""Objects a worker that are tried out to learn how fast this machine is."""
ROUNDS = 3
"""Times a choice is tried out and made anew: the first already differs little."""


@dataclass(frozen=True)
class _Asked:
    """What the options say."""

    aim: str
    manifest: str
    folder: Path | None
    budget: str | None
    error: str | None

    def choose(self, trades: Sequence[Trade], paces: Mapping[str, Pace], objects: Sequence[Object], workers: int) -> list[Choice]:
        learned = sum(item.split == "train" for item in objects)
        counts = {trade.stage: learned if trade.whole else len(objects) for trade in trades}
        if self.budget is not None:
            seconds = duration(self.budget)
            try:
                return within_time(trades, paces, counts, workers, seconds)
            except AdviceError:
                if paces:
                    raise
                return fastest(trades, paces, counts, workers)  # this machine may be faster than the one that measured
        return within_error(trades, paces, counts, workers, error_limit(str(self.error)), PRESET)

    @property
    def beside(self) -> str:
        """What the command does that is not in the time."""
        return "" if self.aim == "train" else " and what the contact sheets take"

    def command(self, settings: Sequence[str]) -> str:
        folder = f" OBJECTS={self.folder}" if self.folder else ""
        network = " CONFIGURATIONS=touch" if self.aim == "train" else ""
        return f"make {self.aim} MANIFEST={self.manifest}{folder} PRESET={PRESET}{network}" + (
            f' SET="{" ".join(settings)}"' if settings else ""
        )


def advise(
    manifest: ManifestOption = "toy",
    aim: Annotated[str, typer.Option("--for", help="dataset, or train: the data and the network that only feels.")] = "dataset",
    budget: Annotated[str | None, typer.Option(help="Time for all of it, as 90s, 10min or 1.5h.")] = None,
    error: Annotated[
        str | None, typer.Option(help="What a stage's error shall stay below, as 5um, 2% or simulate-touch=1um: see docs/tradeoff.md.")
    ] = None,
    objects: ObjectsOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Advise settings: the most accurate within a time, or the fastest within an error.

    A few of the manifest's objects are made first, so that times are this machine's and these objects'.
    """
    started = time.process_time()  # what any command takes to begin
    if (budget is None) == (error is None):
        fail("give either --budget or --error")
    if aim not in AIMS:
        fail(f"--for {aim}: it is {' or '.join(AIMS)}")
    with failures_as_words():
        if unmeasured := [stage for stage in AIMS[aim] if stage not in load_trades()]:
            fail(f"{', '.join(unmeasured)}: not measured; run make tradeoff")
        trades = [load_trades()[stage] for stage in AIMS[aim]]
        asked = _Asked(aim, manifest, objects, budget, error)
        everything = load_manifest(manifest).objects(objects)
        if aim == "train" and len(everything) < 2:
            fail(f"{manifest} has {len(everything)} object; a training needs two, to learn from and to stop by")
        try:
            chosen = _choose(trades, asked, everything, started)
        except AdviceError as unable:
            fail(unable)
        except KeyboardInterrupt:
            fail("interrupted; what was tried out is gone")
        if as_json:
            typer.echo(_as_json(chosen, asked, len(everything)))
        else:
            _print(chosen, asked, len(everything))


def _choose(trades: Sequence[Trade], asked: _Asked, objects: Sequence[Object], started: float) -> list[Choice]:
    """Choose, try out, and choose again, until what was tried is what is chosen, or `ROUNDS` choices were."""
    workers = len(os.sched_getaffinity(0))
    some = some_of(objects, TRIED_AN_WORKER * workers)
    paces: dict[str, Pace] = {}
    tried: list[list[str]] = []
    with TemporaryDirectory() as place, redirect_stdout(sys.stderr):  # standard output is for the advice
        while True:
            chosen = asked.choose(trades, paces, objects, workers)
            labels = [f"{choice.trade.stage} {choice.point.label}" for choice in chosen]
            if labels in tried or len(tried) == ROUNDS:
                return chosen
            errors.print(escape(f"trying out {', '.join(labels)} on {len(some)} objects"))
            data, settings = Path(place) / str(len(tried)), [*_settings(chosen), FELT]
            for choice in chosen:
                stage = load_stage(choice.trade.stage)
                request = make_request(stage, asked.manifest, PRESET, data, asked.folder, settings, None, workers=workers)
                paces[choice.trade.stage] = _pace(request, some, choice, started)
            tried.append(labels)


def _pace(request: Request[Any], some: Sequence[Object], choice: Choice, started: float) -> Pace:
    """How fast this machine is at a choice; of a training, by one of its epochs."""
    if is_set_stage(request.stage):
        seconds, beside = probe_training(request, some, errors)
        epochs = int(request.settings.results()["epochs"])
        return Pace(seconds * epochs * choice.trade.objects / choice.point.seconds, started + beside)
    found = probe(request, some)
    return Pace(found.seconds / choice.point.seconds, started + found.beside, found.packing / choice.point.kilobytes)


def _settings(chosen: Sequence[Choice]) -> list[str]:
    """What `--set` has to say beside the preset."""
    standing = {choice.trade.stage: resolve(load_stage(choice.trade.stage), PRESET, [], STAGES).accuracy() for choice in chosen}
    return [line for choice in chosen for line in assignments(choice, standing[choice.trade.stage])]


def _print(chosen: Sequence[Choice], asked: _Asked, objects: int) -> None:
    table = Table("stage", "setting", "s", "MB", "error", "at most", "", box=None, padding=(0, 2))
    settings = _settings(chosen)
    for choice in chosen:
        point = choice.point
        numbers = (f"{choice.seconds:.0f}", f"{_megabytes(choice, objects):.3g}", f"{point.error:.3g}", f"{point.bound:.3g}")
        table.add_row(choice.trade.stage, escape(point.label), *numbers, escape(_metric(choice, settings)))
    console.print(table)
    say(f"{objects} objects in about {sum(choice.seconds for choice in chosen) / 60:.1f} min{asked.beside}:")
    say(f"  {asked.command(settings)}")


def _as_json(chosen: Sequence[Choice], asked: _Asked, objects: int) -> str:
    settings = _settings(chosen)
    stages = {
        choice.trade.stage: {
            "setting": choice.point.label,
            "seconds": round(choice.seconds, 1),
            "megabytes": round(_megabytes(choice, objects), 2),
            "error": choice.point.error,
            "bound": choice.point.bound,
            "metric": _metric(choice, settings),
        }
        for choice in chosen
    }
    network = [FELT] if asked.aim == "train" else []
    seconds = round(sum(choice.seconds for choice in chosen), 1)
    return json.dumps(
        {"objects": objects, "seconds": seconds, "stages": stages, "set": [*settings, *network], "command": asked.command(settings)},
        indent=2,
    )


def _megabytes(choice: Choice, objects: int) -> float:
    return choice.point.kilobytes * (1 if choice.trade.whole else objects) / 1e3


def _metric(choice: Choice, settings: Sequence[str]) -> str:
    """What the error is, and what was asked for when it was measured, where this is another."""
    return choice.trade.metric + choice.trade.apart(resolve(load_stage(choice.trade.stage), PRESET, [*settings, FELT], STAGES))
