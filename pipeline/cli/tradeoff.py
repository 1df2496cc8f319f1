"""`vt-pipeline tradeoff`, `advise` and `sweep`: measure settings, choose among them, and train over a grid of them."""

import itertools
import os
import shlex
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import yaml
from typer import Argument, Option

from pipeline.cli import options
from pipeline.cli.failures import fail
from pipeline.cli.options import of_run
from pipeline.cli.run import complete_stage, print_made
from pipeline.config.manifest import load_manifest
from pipeline.console import console, duration, pluralise, print_lines, print_warning, show_tables
from pipeline.engine.make import make
from pipeline.errors import StageError, unknown_name
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location, on_disk
from pipeline.tradeoff import sweep as sweeps
from stages.registry import DATASET, STAGES, TRADED, assignment, default_location, load_stage, make_request, resolve

if TYPE_CHECKING:  # the commands below import these when they are called: scipy and matplotlib take most of a second
    from pipeline.tradeoff.trades import MeasuredTrade


def tradeoff(
    stages: Annotated[list[str] | None, Argument(help=f"Of {', '.join(TRADED)}; by default those that make a dataset.")] = None,
    manifest: options.ManifestOption = "toy",
    preset: options.PresetOption = "draft",
    data: options.DataOption = None,
    objects: options.ObjectsOption = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
    assignments: options.SetOption = None,
    minutes: Annotated[float, of_run(min=0.1, help="Time to take; more minutes, more objects.")] = 10,
    until: Annotated[str | None, of_run(help="evaluate: vary what a dataset is made of, and measure reconstructions.")] = None,
) -> None:
    """Measure on a sample of the objects how settings trade speed for accuracy.

    `vt-pipeline advise` chooses by these figures. What is measured under the same code and settings is not measured again.
    """
    from pipeline.tradeoff.end_to_end import measure_end_to_end
    from pipeline.tradeoff.measure import LONGEST, Setup, forecast, foreseen, measure_trade

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
        cost = partial(foreseen, stage_names, limit=LONGEST * seconds)
        setup = setup.affordable(seconds, cost)
        about = f"about {duration(cost(setup))} on {pluralise(len(setup.objects))}"
        print_lines(f"{', '.join(stage_names)}: {about}, less what is measured already")
        for stage in stage_names:
            if skipped := forecast(stage, setup, LONGEST * seconds)[1]:
                print_lines(f"{stage}: skipped, longer than a quarter of the time even on few objects: {'; '.join(skipped)}")
        for name in stage_names:
            trades.append(measure_trade(name, setup, limit=LONGEST * seconds, deadline=started + seconds, console=console))
            _show(trades[-1], request.data)
    if unfinished := [trade.stage for trade in trades if len(trade.points) < trade.total]:
        print_warning("time is up:", f"{', '.join(unfinished)}: the same command measures the rest")


def _show(trade: "MeasuredTrade", data: Path) -> None:
    """Print a trade, and draw it beside its figures."""
    from pipeline.tradeoff.trade_pictures import draw_trade, trade_table
    from pipeline.tradeoff.trades import FOLDER

    show_tables([trade_table(trade)])
    if trade.points:
        draw_trade(trade, path := data / FOLDER / f"{trade.stage}.svg", trade.own())
        print_lines(path)


def advise(
    manifest: options.ManifestOption = "toy",
    preset: options.PresetOption = "draft",
    data: options.DataOption = None,
    objects: options.ObjectsOption = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
    assignments: options.SetOption = None,
    within: Annotated[str | None, Option(help="Time for all stages, as 90s, 10min, 3h or 2d.")] = None,
    error: Annotated[str | None, Option(help="Limit on every error of the kind, as 0.1mm or 5%, or on one stage's: train-gcn=12.")] = None,
    count: Annotated[int | None, Option(min=1, help="How many objects; by default those of the sample.")] = None,
    cores: Annotated[int | None, Option(min=1, help="How many cores; by default this machine's.")] = None,
) -> None:
    """Advise settings for a time or for an error.

    It chooses among what `vt-pipeline tradeoff` measured. With --within: the most accurate within that time; with --error: the fastest
    within that error.
    """
    from pipeline.tradeoff.measure import Setup, current_trades
    from pipeline.tradeoff.trade_pictures import choice_table
    from pipeline.tradeoff.trades import Workload, parse_duration, parse_limit, within_error, within_time

    if (within is None) == (error is None):
        fail("give either --within or --error")
    where = on_disk(as_location(default_location(manifest, objects) / preset if data is None else data))
    if where is None:
        fail(f"--data {data}: give the folder that `vt-pipeline tradeoff` measured into")
    limit = None if error is None else parse_limit(error)  # before anything else, so that a mistake in it is reported first
    seconds = 0.0 if within is None else parse_duration(within)
    described = load_manifest(manifest).with_units(units, up)
    trades = current_trades(Setup(where, described.name, (), described.seed, preset, tuple(assignments or ())))
    workload = Workload(count or len(trades[0].objects), cores or len(os.sched_getaffinity(0)))
    choices = within_time(trades, workload, seconds) if limit is None else within_error(trades, workload, limit)
    show_tables([choice_table(choices, workload)])
    counts = [len(trade.objects) for trade in trades]
    measured_on = pluralise(max(counts)) if min(counts) == max(counts) else f"{min(counts)} to {max(counts)} objects"
    work = f"{pluralise(workload.objects)} on {pluralise(workload.cores, 'core')}"
    changed = [*(assignments or ()), *(line for choice in choices for line in choice.assignments())]
    print_lines(
        f"measured on {measured_on}, {', '.join(sorted({trade.machine for trade in trades}))}",
        f"{work}: {duration(sum(choice.seconds for choice in choices))}, and seconds to start each stage, with these settings:",
        f"  --preset {preset}" + "".join(f" --set {shlex.quote(line)}" for line in changed),
    )


def sweep(
    stage: Annotated[str, Argument(help="A stage that trains.", autocompletion=complete_stage)],
    grid: Annotated[list[str] | None, Option(help="SETTING=VALUE,VALUE,… to try; without any, the supplement's grid.")] = None,
    manifest: options.ManifestOption = "toy",
    preset: options.PresetOption = "draft",
    data: options.DataOption = None,
    objects: options.ObjectsOption = None,
    units: options.UnitsOption = None,
    up: options.UpOption = None,
    assignments: options.SetOption = None,
    seed: options.SeedOption = None,
    dry_run: Annotated[bool, Option(help="List the points, and do nothing.")] = False,
) -> None:
    """Train over a grid of hyperparameters.

    By default the grid is the supplement's (2.2 and 3.4). A sweep that was killed continues when it is run again.
    """
    named: dict[str, Any] = {"data": data, "objects": objects, "assignments": assignments or (), "seed": seed, "units": units, "up": up}
    request = make_request(stage, manifest, preset, **named)
    loaded = request.stage
    if not loaded.trains:
        trainings = [name for name in STAGES if load_stage(name).trains]
        fail(f"{stage} trains nothing: sweep over settings of {', '.join(trainings)}")
    default_grid = loaded.grid(request.settings)
    if not (grid or default_grid):
        fail(f"the supplement has no grid for {stage}: name one, --grid learning_rate=1e-3,2e-3")
    values_by_setting = _grid(grid) if grid else default_grid
    points = []  # all are valid, or none is run
    for values in itertools.product(*values_by_setting.values()):
        point = dict(zip(values_by_setting, values, strict=True))
        varied = [f"{stage}.{assignment(setting, value)}" for setting, value in point.items()]
        points.append((point, resolve(stage, preset, [*(assignments or ()), *varied])))
    finished, failed = [], 0
    for point, settings in points:
        folder = sweeps.point_folder(stage, loaded.writes(settings), point)
        if dry_run:
            print_lines(request.data / folder)
            continue
        try:
            make(replace(request, settings=settings, folder=folder), console, report=print_made)
            finished.append((point, DataDirectory(request.data).folder(folder)))
        except StageError as error:  # a learning rate that is too high fails this point only
            failed += 1
            print_warning("failed", f"{folder}: {error}")
    if finished:
        show_tables([sweeps.sweep_table(finished)])
    if failed:
        fail(f"{pluralise(failed, 'point')} failed, see above")


def _grid(grids: list[str]) -> dict[str, list[Any]]:
    grid = {}
    for option in grids:
        setting, separator, values = option.partition("=")
        if setting in grid or "." in setting:
            fail(f"--grid {option}: name each setting once, with all its values, and without its stage: SETTING=VALUE,VALUE,…")
        try:
            grid[setting] = yaml.safe_load(values if values.startswith("[") else f"[{values}]") if separator else []
        except (yaml.YAMLError, ValueError, RecursionError):
            grid[setting] = []
        if not grid[setting]:
            fail(f"--grid {option}: write SETTING=VALUE,VALUE,…")
        if twice := [value for number, value in enumerate(grid[setting]) if value in grid[setting][:number]]:
            fail(f"--grid {option}: {twice[0]} is named twice; name each value once")
    return grid
