"""`vt-pipeline tradeoff`: measure the time and the error of settings."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.failures import fail
from pipeline.cli.request import (
    RUN,
    DataOption,
    ManifestOption,
    ObjectsOption,
    PresetOption,
    SetOption,
    UnitsOption,
    UpOption,
)
from pipeline.console import console, errors, pluralise, print_line, show_tables
from pipeline.errors import unknown_name
from stages.registry import DATASET, TRADED, make_request

if TYPE_CHECKING:  # the commands below import these when they are called: scipy and matplotlib take most of a second
    from pipeline.tradeoff.measure import Setup
    from pipeline.tradeoff.measured import MeasuredTrade


def tradeoff(
    stages: Annotated[list[str] | None, typer.Argument(help=f"Of {', '.join(TRADED)}; by default those that make a dataset.")] = None,
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    objects: ObjectsOption = None,
    units: UnitsOption = None,
    up: UpOption = None,
    assignments: SetOption = None,
    minutes: Annotated[float, typer.Option(min=0.1, help="Time to take; more minutes, more objects.", rich_help_panel=RUN)] = 10,
    until: Annotated[
        str | None, typer.Option(help="evaluate: vary what a dataset is made of, and measure reconstructions.", rich_help_panel=RUN)
    ] = None,
) -> None:
    """Measure on a sample of the objects how settings trade speed for accuracy.

    `vt-pipeline advise` chooses by these figures. What is measured under the same code and settings is not measured again.
    """
    from pipeline.tradeoff.end_to_end import measure_end_to_end
    from pipeline.tradeoff.measure import LONGEST, Setup, measure_trade

    stage_names = tuple(stages or DATASET)
    if strange := [name for name in stage_names if name not in TRADED]:
        fail(unknown_name("stage", strange[0], TRADED))
    if until not in (None, "evaluate"):
        fail(f"--until {until}: only evaluate ends a pipeline")
    if until and stages:
        fail(f"--until {until} measures whole pipelines; leave {' '.join(stages)} out")
    request = make_request(stage_names[0], manifest, preset, data=data, objects=objects, assignments=assignments or (), units=units, up=up)
    if not isinstance(request.data, Path):
        fail(f"--data {request.data}: times in object storage say little; measure into a folder on this machine")
    if not request.objects:
        fail(f"manifest {request.manifest} has no objects; give --objects FOLDER")
    started, seconds = time.monotonic(), 60 * minutes
    setup = Setup(request.data, request.manifest, request.objects, request.seed, preset, tuple(assignments or ()))
    trades = []
    if until:
        trades.append(measure_end_to_end(setup, seconds, console))
        _show(trades[0], request.data)
    else:
        setup = setup.affordable(seconds, lambda sample: _foreseen(stage_names, sample, seconds))
        _announce(stage_names, setup, seconds)
        for name in stage_names:
            trades.append(measure_trade(name, setup, limit=LONGEST * seconds, deadline=started + seconds, console=console))
            _show(trades[-1], request.data)
    if unfinished := [trade.stage for trade in trades if len(trade.points) < trade.total]:
        errors.print(f"[yellow]time is up[/]: {', '.join(unfinished)}: the same command measures the rest")


def _foreseen(stages: tuple[str, ...], setup: Setup, seconds: float) -> float:
    """Foresee the seconds of stages with all their candidates, and of the stages before them once."""
    from pipeline.tradeoff.measure import LONGEST, forecast, stages_before

    before = {name for stage in stages for name in stages_before(stage, setup)}
    inputs = sum(map(setup.seconds, before))
    return inputs + sum(forecast(stage, setup, LONGEST * seconds)[0] for stage in stages)


def _announce(stages: tuple[str, ...], setup: Setup, seconds: float) -> None:
    from pipeline.tradeoff.measure import LONGEST, forecast

    foreseen = _foreseen(stages, setup, seconds)
    print_line(
        f"{', '.join(stages)}: about {max(foreseen / 60, 0.1):.1f} min on {pluralise(len(setup.objects))}, less what is measured already"
    )
    for stage in stages:
        if skipped := forecast(stage, setup, LONGEST * seconds)[1]:
            print_line(f"{stage}: skipped, longer than a quarter of the time even on few objects: {'; '.join(skipped)}")


def _show(trade: MeasuredTrade, data: Path) -> None:
    """Print a trade, and draw it beside its figures."""
    from pipeline.tradeoff.measured import FOLDER
    from pipeline.tradeoff.trade_pictures import draw_trade, trade_table

    show_tables(console, [trade_table(trade)])
    if trade.points:
        draw_trade(trade, path := data / FOLDER / f"{trade.stage}.svg", trade.own())
        print_line(f"{path}")
