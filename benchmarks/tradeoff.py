"""Measure the trades of all stages, whole datasets end to end, and whether advice keeps its promises; write `docs/tradeoff.md`.

`make tradeoff`; a killed run continues.
"""

import csv
import io
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.provenance import provenance
from pipeline.config.manifest import load_manifest
from pipeline.console import console
from pipeline.store.atomic import write_atomically
from pipeline.tradeoff.end_to_end import measure_end_to_end
from pipeline.tradeoff.measure import Setup, measure_trade, stratified
from pipeline.tradeoff.trade_pictures import draw_trade
from pipeline.tradeoff.trades import END_TO_END, MeasuredTrade, Workload, read_trade, within_time
from stages.registry import DATASET, TRADED

MANIFEST = Path(__file__).with_suffix(".yaml")
LEARNING = 16
"""Objects that trainings are compared on."""
LIMIT = 40.0
"""Seconds, foreseen, of the longest candidate with four objects."""
END_OBJECTS, END_EPOCHS = 20, 10
"""Objects of each dataset end to end, and epochs of its networks."""
TRIALS = 20

INTRODUCTION = """\
# Speed against accuracy

These tables show what settings cost and how accurate they are, for 64 objects: 48 modelled in four classes, which are in no other manifest,
and 16 meshes of the pybullet wheel. `vt-pipeline tradeoff` measures the same on your objects and your machine, and `vt-pipeline advise`
chooses by it. A square marks the draft preset. The line joins the Pareto-optimal settings: no other is both faster and more accurate.
Bars are 95 % intervals over objects. All figures, sizes too, are in [tradeoff.csv](tradeoff/tradeoff.csv).
"""
END = """\
## Which change to a dataset pays most

Each point is a dataset that differs from the first in one thing, and the reconstructions that a network with vision and touch learns from
it. Time is that of making the dataset and of all trainings; the error is that with one and two grasps given.
"""
PROMISES = """\
## What advice promises

`vt-pipeline advise --within` was asked {trials} times, each time with another random half of the objects as the sample; its choice was
compared with what was measured on the other half. {fast} of {trials} predicted times were within 15 %, and {true} of {bounds} errors below
their bounds.

| time asked for, s per object | predicted | measured | off, % | errors below their bounds |
| --- | --- | --- | --- | --- |
"""


def main(
    data: Annotated[Path, typer.Option(help="Where it is measured.")] = Path("data/tradeoff"),
    only: Annotated[
        str | None, typer.Option(help="end: datasets end to end; stages: the stages; by default both, at the same time.")
    ] = None,
    write: Annotated[Path | None, typer.Option(help="Page to write; pictures and figures go into the folder of the same name.")] = None,
) -> None:
    """Measure what is not measured yet, and write the page."""
    manifest = load_manifest(str(MANIFEST))
    objects = manifest.objects(None)
    started = time.monotonic()
    full_setup = Setup(data / "dataset", manifest.name, objects, manifest.seed, "draft")
    learning_setup = Setup(data / "learning", manifest.name, stratified(objects, LEARNING, manifest.seed), manifest.seed, "draft")
    end_objects = stratified(objects, END_OBJECTS, manifest.seed)
    end_setup = Setup(data / "end", manifest.name, end_objects, manifest.seed, "draft", (f"train-gcn.epochs={END_EPOCHS}",))
    if only == "end":
        measure_end_to_end(end_setup, np.inf, console)
        return
    end_process = None if only else subprocess.Popen([sys.executable, "-m", "benchmarks.tradeoff", "--data", str(data), "--only", "end"])
    for stage in TRADED:
        measure_trade(stage, full_setup if stage in DATASET else learning_setup, limit=LIMIT, deadline=np.inf, console=console)
    if end_process is not None and end_process.wait():
        raise SystemExit("the measurement end to end failed; see above")
    if write is not None:
        minutes = (time.monotonic() - started) / 60
        trades = [read_trade((full_setup if stage in DATASET else learning_setup).data, stage) for stage in TRADED]
        _write(write, [trade for trade in trades if trade], read_trade(end_setup.data, END_TO_END), minutes)


def _write(page: Path, trades: list[MeasuredTrade], end: MeasuredTrade | None, minutes: float) -> None:
    folder = page.with_suffix("")
    folder.mkdir(exist_ok=True)
    about = provenance("make tradeoff", "python -m benchmarks.tradeoff")
    provenance_line = f"`{about['command']}`, commit {about['commit']}, {about['machine']}, {about['date']}: {minutes:.0f} minutes.\n"
    parts = [INTRODUCTION, provenance_line]
    if end is not None:
        parts += [END, *_section(end, page, title=False)]
    for trade in trades:
        parts += _section(trade, page)
    parts.append(_promises([trade for trade in trades if trade.stage in DATASET]))
    page.write_text("\n".join(parts))
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow(["stage", "settings", "presets", "seconds", "kilobytes", "error", "low", "high", "unit", "metric"])
    for trade in [*([end] if end else []), *trades]:
        for point in trade.points:
            numbers = [f"{value:.4g}" for value in (point.seconds, point.kilobytes, point.error, point.interval.low, point.interval.high)]
            rows.writerow([trade.stage, point.label, " ".join(point.presets), *numbers, trade.unit, trade.metric])
    write_atomically(folder / "tradeoff.csv", buffer.getvalue().encode())


def _section(trade: MeasuredTrade, page: Path, *, title: bool = True) -> list[str]:
    """Write the picture and the short table of a trade: its front, its presets."""
    draw_trade(trade, page.with_suffix("") / f"{trade.stage}.svg", trade.own())
    lines = [f"## {trade.stage}\n"] if title else []
    lines += [f"![{trade.stage}: {trade.metric} over {trade.cost}]({page.stem}/{trade.stage}.svg)\n", f"{len(trade.objects)} objects.\n"]
    unit = f", {trade.unit}" if trade.unit else ""
    lines += [f"| settings | {trade.cost} | {trade.metric}{unit} | 95 % interval |", "| --- | --- | --- | --- |"]
    best = {point.label for point in trade.front()}
    points = trade.points if trade.stage == END_TO_END else [point for point in trade.points if point.label in best or point.presets]
    for point in sorted(points, key=lambda point: point.seconds):
        name = f"**{point.label}**" if point.label in best else point.label
        lines.append(f"| {name} | {point.seconds:.3g} | {point.error:.3g} | {point.interval.low:.3g} to {point.interval.high:.3g} |")
    return [*lines, "\nNo other setting beats those in bold.\n"]


def _half(trade: MeasuredTrade, names: set[str]) -> MeasuredTrade:
    """Keep what was measured on some of the objects."""
    points = [
        point.model_copy(
            update={field: {name: value for name, value in getattr(point, field).items() if name in names} for field in ("times", "errors")}
        )
        for point in trade.points
    ]
    return trade.model_copy(update={"points": tuple(points), "objects": tuple(sorted(names))})


def _promises(trades: list[MeasuredTrade]) -> str:
    """Take advice from one half of the objects, and compare it with what was measured on the other half."""
    rng, names = np.random.default_rng(0), np.array(sorted(trades[0].objects))
    rows, fast, true, bounds = [], 0, 0, 0
    for _ in range(TRIALS):
        sampled = set(rng.permutation(names)[: len(names) // 2].tolist())
        measured, held_out = ([_half(trade, part) for trade in trades] for part in (sampled, set(names.tolist()) - sampled))
        load = Workload(len(names) - len(sampled), 1)
        fastest, slowest = (sum(end(point.seconds for point in trade.points) for trade in measured) for end in (min, max))
        seconds = float(np.exp(rng.uniform(np.log(1.05 * fastest), np.log(slowest))))
        choices = within_time(measured, load, seconds * load.objects)
        outcomes = [
            next(point for point in trade.points if point.label == choice.point.label)
            for trade, choice in zip(held_out, choices, strict=True)
        ]
        predicted, took = sum(choice.seconds for choice in choices) / load.objects, sum(point.seconds for point in outcomes)
        kept_bounds = sum(point.error <= choice.bound for point, choice in zip(outcomes, choices, strict=True))
        fast, true, bounds = fast + (abs(took / predicted - 1) <= 0.15), true + kept_bounds, bounds + len(choices)
        rows.append(
            f"| {seconds:.3g} | {predicted:.3g} | {took:.3g} | {100 * (took / predicted - 1):+.0f} | {kept_bounds} of {len(choices)} |"
        )
    return PROMISES.format(trials=TRIALS, fast=fast, true=true, bounds=bounds) + "\n".join(rows) + "\n"


if __name__ == "__main__":
    typer.run(main)
