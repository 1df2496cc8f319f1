"""`vt-pipeline advise`: choose settings for a time or an error."""

from __future__ import annotations

import os
import shlex
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.failures import fail
from pipeline.cli.request import DataOption, ManifestOption, PresetOption, SetOption
from pipeline.config.manifest import load_manifest
from pipeline.console import Row, Table, console, pluralise, print_line, show_tables
from pipeline.store.storage import as_location, on_disk
from stages.registry import DATASET, TRADED, default_place

if TYPE_CHECKING:  # imported when the command is called: scipy takes long
    from pipeline.tradeoff.advice import Choice, Workload
    from pipeline.tradeoff.measure import Setup
    from pipeline.tradeoff.measured import MeasuredTrade


def advise(
    manifest: ManifestOption = "toy",
    preset: PresetOption = "draft",
    data: DataOption = None,
    assignments: SetOption = None,
    within: Annotated[str | None, typer.Option(help="Time for all stages, as 90s, 10min, 3h or 2d.")] = None,
    error: Annotated[
        str | None, typer.Option(help="Limit on every error of the kind, as 0.1mm or 5%, or on one stage's: train-gcn=12.")
    ] = None,
    objects: Annotated[int | None, typer.Option(min=1, help="How many objects; by default those of the sample.")] = None,
    cores: Annotated[int | None, typer.Option(min=1, help="How many cores; by default this machine's.")] = None,
) -> None:
    """Advise settings for a time or for an error.

    It chooses among what `vt-pipeline tradeoff` measured. With --within: the most accurate within that time; with --error: the fastest
    within that error.
    """
    from pipeline.tradeoff.advice import Workload, parse_duration, parse_limit, within_error, within_time
    from pipeline.tradeoff.measure import Setup

    if (within is None) == (error is None):
        fail("give either --within or --error")
    where = on_disk(as_location(default_place(manifest, None) / preset if data is None else data))
    if where is None:
        fail(f"--data {data}: give the folder that `vt-pipeline tradeoff` measured into")
    limit = None if error is None else parse_limit(error)  # before anything else, so that a mistake in it is reported first
    seconds = 0.0 if within is None else parse_duration(within)
    described = load_manifest(manifest)
    trades = _current(Setup(where, described.name, (), described.seed, preset, tuple(assignments or ())))
    workload = Workload(objects or len(trades[0].objects), cores or len(os.sched_getaffinity(0)))
    choices = within_time(trades, workload, seconds) if limit is None else within_error(trades, workload, limit)
    show_tables(console, [_table(choices, workload)])
    counts = [len(trade.objects) for trade in trades]
    measured_on = pluralise(max(counts)) if min(counts) == max(counts) else f"{min(counts)} to {max(counts)} objects"
    print_line(f"measured on {measured_on}, {', '.join(sorted({trade.machine for trade in trades}))}")
    work = f"{pluralise(workload.objects)} on {pluralise(workload.cores, 'core')}"
    print_line(f"{work}: {_duration(sum(choice.seconds for choice in choices))}, and seconds to start each stage, with these settings:")
    changed = [*(assignments or ()), *(line for choice in choices for line in choice.assignments())]
    print_line(f"  --preset {preset}" + "".join(f" --set {shlex.quote(line)}" for line in changed))


def _current(setup: Setup) -> list[MeasuredTrade]:
    """Read the trades that were measured with these settings and this code; fail if one that makes a dataset is missing."""
    from pipeline.tradeoff.measure import stage_key
    from pipeline.tradeoff.measured import read_trade

    trades = []
    for stage in TRADED:
        trade = read_trade(setup.data, stage)
        if trade is not None and trade.points and trade.key == stage_key(stage, setup):
            trades.append(trade)
        elif trade is not None or stage in DATASET:
            how = "not measured yet" if trade is None else "measured with other settings or other code"
            options = "".join(f" --set {shlex.quote(line)}" for line in setup.assignments)
            command = f"vt-pipeline tradeoff {stage} --data {shlex.quote(str(setup.data))} --preset {setup.preset}{options}"
            fail(f"{stage}: {how}; name the --data of `vt-pipeline tradeoff`, or run `{command}`, with your manifest and objects")
    return trades


def _table(choices: list[Choice], workload: Workload) -> Table:
    rows = []
    for choice in choices:
        point, trade = choice.point, choice.trade
        megabytes = point.kilobytes * (1 if trade.trained else workload.objects) / 1e3
        rows.append(
            Row([trade.stage, point.label, choice.seconds, megabytes, point.error, choice.bound, f"{trade.unit} {trade.metric}".strip()])
        )
    return Table("", ["stage", "settings", "s", "MB", "error", "at most", ""], rows, ["", "", ".3g", ".3g", ".3g", ".3g", ""])


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
