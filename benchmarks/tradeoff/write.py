"""What was measured, written down: figures that `vt-pipeline` reads, a page with tables, and a plot a study."""

from __future__ import annotations

import datetime
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.provenance import ROOT, commit, machine
from benchmarks.tradeoff.plot import draw
from pipeline.tuning.tradeoff import ASSET, SLACK, Point, Trade, load_trades

PAGE = ROOT / "docs" / "tradeoff.md"
PLOTS = ROOT / "docs" / "tradeoff"
SECTIONS = ("same", "end_to_end", "alternatives", "shortcuts")
BEGIN = """# Speed against accuracy

Every setting that changes results, varied alone and with others, and the presets as wholes: what a setting costs and how wrong it is.
Seconds and kilobytes are an object's on one core; where a stage looks at all objects at once, the whole training's. **•** marks settings
that none beats in both cost and error (times within {slack:.0f} % count as equal). *At most* is what the error of another data set of as
many such objects stays below, 19 times in 20; `vt-pipeline advise` reads these figures, and promises that one.
"""
NOTES = {
    "sample-surfaces": "On these objects 128 directions find what 256 find. No preset takes fewer: their number is part of what an "
    "exterior point is, and on objects of abutting parts more keep finding the walls of narrower gaps.",
    "simulate-grasps": "Single settings are varied at `attempts=12`: with 50 nearly every sensor touches whatever the others are.",
    "simulate-touch": "The error of `sphere` is its tolerance; `paper` keeps it because the supplement prescribes it, beaten in cost.",
    "fit-charts": "`paper` goes on as long as the supplement's rule says, with its step: 25 times the time, and no closer.",
    "train-unet": "Seeds differ from the base in nothing but chance: what differs by no more than they do is not told apart here.",
    "train-gcn": "As above: compare with the seeds before believing a difference. A network that only feels has no image "
    "encoder: the encoder's settings are of no account here.",
}


def read_asset() -> dict[str, Any]:
    """What was measured last; empty sections where nothing was."""
    path = ROOT / "pipeline" / ASSET
    content: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    return {"made": {}, "trades": {}} | {name: [] for name in SECTIONS} | content


def stamp() -> dict[str, str]:
    """The command, commit, machine and day of a measurement."""
    command = " ".join(["python -m benchmarks.tradeoff", *sys.argv[1:]]) if sys.argv[1:] else "make tradeoff"
    return {"command": command, "commit": commit(), "machine": machine(), "date": datetime.date.today().isoformat()}


def write_asset(found: dict[str, Any]) -> None:
    """Write the figures where the package finds them."""
    text = json.dumps({key: found[key] for key in ("made", "trades", *SECTIONS)}, indent=1, sort_keys=False, allow_nan=False)
    (ROOT / "pipeline" / ASSET).write_text(text + "\n")
    load_trades.cache_clear()


def write_page(found: dict[str, Any]) -> None:
    """Write the page and the plots."""
    PLOTS.mkdir(parents=True, exist_ok=True)
    parts = [BEGIN.format(slack=100 * SLACK["seconds"])]
    for trade in load_trades().values():
        picture = PLOTS / f"{trade.name.replace(' ', '-')}.png"
        draw(trade, picture)
        parts.append(_section(trade, picture, _made(found["made"][trade.name])))
    written = {"end_to_end": _end_to_end, "alternatives": _alternatives, "same": _same, "shortcuts": _shortcuts}
    parts += [write(found[name], _made(found["made"][name])) for name, write in written.items() if found[name]]
    PAGE.write_text("\n".join(parts))


def _made(made: Mapping[str, str]) -> str:
    return f"`{made['command']}`, commit {made['commit']}, {made['machine']}, {made['date']}."


def _section(trade: Trade, picture: Path, made: str) -> str:
    front = trade.front()
    figures = list(trade.points[0].figures)
    head = ["", "setting", "seconds", "kB", figures[0], "at most", *figures[1:]]
    rows = [_row(point, point in front, figures) for kind in ("preset", "setting", "together", "seed") for point in _of(trade, kind)]
    skipped = [f"Not measured as a whole: `{preset}` ({why})." for preset, why in trade.skipped.items()]
    notes = [*skipped, *([NOTES[trade.name]] if trade.name in NOTES else [])]
    text = " ".join(notes) + "\n\n" if notes else ""
    return f"## {trade.name}\n\n{trade.objects} objects. {made}\n\n![{trade.name}](tradeoff/{picture.name})\n\n{text}{_table(head, rows)}"


def _of(trade: Trade, kind: str) -> list[Point]:
    return [point for point in trade.points if point.kind == kind]


def _row(point: Point, best: bool, figures: Sequence[str]) -> list[str]:
    label = f"**{point.label}**" if point.kind == "preset" else f"`{point.label}`" if point.kind in ("setting", "together") else point.label
    error, *others = (f"{point.figures[name]:.4g}" for name in figures)
    return ["•" if best else "", label, f"{point.seconds:.3g}", f"{point.kilobytes:.4g}", error, f"{point.bound:.4g}", *others]


def _end_to_end(rows: list[dict[str, Any]], made: str) -> str:
    head = ["data set", "s an object", "touches, %", "Chamfer x 9000", "95 %"]
    lines = [[row["label"], row["seconds"], row["touches"], row["chamfer"], f"{row['low']} to {row['high']}"] for row in rows]
    say = "Data sets that differ from `draft` in one thing, each learned from and tested with draft's U-Net, charts and touch network.\n\n"
    return f"## What a cheaper data set costs in the end\n\n{made}\n\n{say}{_table(head, lines)}"


def _alternatives(rows: list[dict[str, Any]], made: str) -> str:
    head = ["choice", "", "seconds", "figures"]
    lines = [[row["what"], row["label"], row["seconds"], _words(row["figures"])] for row in rows]
    say = "Choices that are no setting, because one of them serves. Seconds of a sensor's depth map, or of an attempt at a grasp.\n\n"
    return f"## What could be built otherwise\n\n{made}\n\n{say}{_table(head, lines)}"


def _words(figures: dict[str, float]) -> str:
    return "; ".join(f"{name}: {value:.4g}" for name, value in figures.items())


def _same(rows: list[dict[str, Any]], made: str) -> str:
    lines = [[row["stage"], f"`{row['label']}`", row["seconds"], f"`{row['digest'][:16]}`"] for row in rows]
    say = "The digests of what they made, in directories of their own.\n\n"
    return f"## What only changes speed\n\n{made}\n\n{say}{_table(['stage', 'run with', 'seconds', 'digest'], lines)}"


def _shortcuts(rows: list[dict[str, Any]], made: str) -> str:
    head = ["stage", "what is not done", "s with", "s without", "times", "difference of results"]
    lines = [
        [
            *(row["stage"], row["what"], f"{row['seconds_with']:.3g}", f"{row['seconds_without']:.3g}"),
            *(f"{row['seconds_without'] / row['seconds_with']:.1f}", row["difference"]),
        ]
        for row in rows
    ]
    say = (
        "What the scene does not require is left out (`vt-pipeline run STAGE --explain`): the same work with and without each shortcut.\n\n"
    )
    return f"## Only what a scene requires\n\n{made}\n\n{say}{_table(head, lines)}"


def _table(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in (head, ["---"] * len(head), *rows))
