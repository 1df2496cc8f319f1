"""Write `docs/tradeoff.md`: a table and a plot per study, and the sections beside them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.provenance import ROOT
from benchmarks.tradeoff.plot import draw
from pipeline.tradeoff.measurements import TIE_TOLERANCE, Measurement, Provenance, Study

PAGE = ROOT / "docs" / "tradeoff.md"
PLOTS = ROOT / "docs" / "tradeoff"
BEGIN = """# Speed against accuracy

Each table shows the cost and the error of the presets and of the settings on the front (**•**): no other setting beats those in both
(times within {tolerance:.0f} % count as equal). The pictures show every setting that was measured. Seconds and kilobytes are per object on
one core, or for the whole training where a stage processes the dataset as one. *At most* is the 95 % upper bound of the error on another
dataset of as many such objects; `vt-pipeline advise` uses that bound. The line above each table names its commit;
`make tradeoff-missing` lists what has changed since.
"""
NOTES = {
    "sample-surfaces": "On these objects 128 directions find what 256 find. No preset takes fewer: their number is part of what an "
    "exterior point is, and on objects of abutting parts more keep finding the walls of narrower gaps.",
    "simulate-grasps": "Single settings are varied at `attempts=12`: with 50 nearly every sensor touches whatever the others are.",
    "simulate-touch": "The error of `sphere` is its tolerance; `paper` keeps it because the supplement prescribes it, although `ray` is "
    "faster and more accurate. Settings of the sensor file are [below](#settings-of-a-sensor-file).",
    "fit-charts": "`paper` continues as long as the supplement's rule says, with its step: 25 times the time, and no closer.",
    "train-gcn": "A network with touch alone has no image encoder: the encoder's settings change nothing here.",
}
KINDS = ("preset", "setting", "combination")


def write_page(figures: Mapping[str, Any], studies: Iterable[Study]) -> None:
    """Write the page and the plots."""
    PLOTS.mkdir(parents=True, exist_ok=True)
    parts = [BEGIN.format(tolerance=100 * TIE_TOLERANCE["seconds"])]
    for study in studies:
        picture = PLOTS / f"{study.name.replace(' ', '-')}.png"
        draw(study, picture)
        parts.append(study_section(study, picture))
    for name, (title, write) in SECTIONS.items():
        if section := figures["sections"].get(name):
            text, head, rows = write(section["rows"])
            parts.append(f"## {title}\n\n{_source(Provenance(**section['provenance']))}\n\n{text}\n\n{_table(head, rows)}")
    PAGE.write_text("\n".join(parts))


def study_section(study: Study, picture: Path) -> str:
    """Write a study's section."""
    front, figures = study.front(), list(study.measurements[0].figures)
    head = ["", "setting", "seconds", "kB", figures[0], "at most", *figures[1:]]
    kept = [one for kind in KINDS for one in study.measurements if one.kind == kind and (kind == "preset" or one in front)]
    rows = [_row(one, one in front, figures) for one in kept]
    notes = [f"Not measured as a whole: `{preset}` ({why})." for preset, why in study.skipped.items()]
    notes += [NOTES[study.name]] if study.name in NOTES else []
    text = " ".join(notes) + "\n\n" if notes else ""
    stamp = f"{study.objects} objects. {_source(study.provenance)}"
    return f"## {study.name}\n\n{stamp}\n\n![{study.name}](tradeoff/{picture.name})\n\n{text}{_table(head, rows)}"


def _source(made: Provenance) -> str:
    return f"`{made.command}`, commit {made.commit}, {made.machine}, {made.date}."


def _row(one: Measurement, best: bool, figures: Sequence[str]) -> list[str]:
    label = f"**{one.label}**" if one.kind == "preset" else f"`{one.label}`"
    error, *others = (f"{one.figures[name]:.4g}" if name in one.figures else "–" for name in figures)
    return ["•" if best else "", label, f"{one.seconds:.3g}", f"{one.kilobytes:.4g}", error, f"{one.bound:.4g}", *others]


_Rows = list[dict[str, Any]]
_Section = tuple[str, Sequence[str], list[list[Any]]]
"""A text, the heads of a table, and its rows."""


def _end_to_end(rows: _Rows) -> _Section:
    text = "Datasets that differ from `draft` in one thing, each used to train and test draft's U-Net, charts and touch network."
    head = ["dataset", "s per object", "touches, %", "Chamfer x 9000", "95 %"]
    return text, head, [[*(row[k] for k in ("label", "seconds", "touches", "chamfer")), f"{row['low']} to {row['high']}"] for row in rows]


def _alternatives(rows: _Rows) -> _Section:
    text = "Choices that are no setting, because one of them is enough. Seconds per depth map of one sensor, or per grasp attempt."
    words = ["; ".join(f"{name}: {value:.4g}" for name, value in row["figures"].items()) for row in rows]
    lines = [[row["what"], row["label"], row["seconds"], line] for row, line in zip(rows, words, strict=True)]
    return text, ["choice", "", "seconds", "figures"], lines


def _same(rows: _Rows) -> _Section:
    lines = [[row["stage"], f"`{row['label']}`", row["seconds"], f"`{row['digest'][:16]}`"] for row in rows]
    return "The digests of the outputs, made in separate directories.", ["stage", "run with", "seconds", "digest"], lines


def _shortcuts(rows: _Rows) -> _Section:
    text = (
        "Work that the scene does not require is left out (`vt-pipeline run STAGE --explain`): the same work with and without each "
        "shortcut.\n\nRemoved on 2026-11-22, because each saved less than 1.5 × of its stage (measured before, commit 891b9e3): rays "
        "beyond the gel 1.2 ×, soundness of what cannot be kept 0.9 ×, the hand's shapes kept between objects 1.1 ×, local points 1.2 × "
        "(the setting `store_points` remains), the image encoder once 1.3 ×, touch features once 1.1 ×, vertices that reach no vision "
        "vertex 1.3 ×, one search tree per true surface 1.1 ×; the shading of an untouched sensor 12.7 ×, but little of its stage; "
        "postures that cannot be the best 1.8 ×, 1.3 × of the stage; points of the Chamfer loss "
        "of `train-unet` beyond 2000 1.8 ×, 1.4 × of the stage (and the setting `loss_points`)."
    )
    head = ["stage", "what is not done", "s with", "s without", "times", "difference of results"]
    lines = []
    for row in rows:
        ours, plain = row["seconds_with"], row["seconds_without"]
        lines.append([row["stage"], row["what"], f"{ours:.3g}", f"{plain:.3g}", f"{plain / ours:.1f}", row["difference"]])
    return text, head, lines


def _training(rows: _Rows) -> _Section:
    text = (
        "Each choice changes one thing of draft's networks, which are trained for half of draft's epochs, implicit ones for a fifth "
        "(manifest `four-classes`, 48 test objects, one grasp); trainings differ by chance alone, and other figures are means over them. "
        "Seconds are the least of three trainings, beside other work."
    )
    head = ["network", "choice", "s", "Chamfer x 9000", "of each training", "median", "area, % of true", "dihedral, °", "99.9 % within, mm"]
    lines = [
        [
            f"`{row['network']}`",
            row["label"],
            f"{row['seconds']:.0f}",
            f"{row['mean']:.2f}",
            ", ".join(f"{one:.2f}" for one in row["each"]),
            f"{row['median']:.2f}",
            f"{100 * row['area_ratio']:.0f}",
            f"{row['dihedral']:.0f}",
            f"{1000 * row['spike']:.0f}",
        ]
        for row in rows
    ]
    return text, head, lines


def _sensors(rows: _Rows) -> _Section:
    text = (
        "Mean |model - photograph|, levels of 255, in the contact of a ball and in the ring from 1 to 3 contact radii, on the photographs "
        "that the sensors were not fitted to: [sensors.md](sensors.md) says which, shows some, and has Taxim beside them. Processor "
        "milliseconds of an image at 480 × 640, depth not counted."
    )
    lines = [[f"`{row['sensor']}`", row["label"], *(f"{row[name]:.1f}" for name in ("ms", "contact", "ring"))] for row in rows]
    return text, ["sensor", "setting", "ms", "in the contact", "ring around it"], lines


SECTIONS = {
    "training": ("What choices in training are worth", _training),
    "sensors": ("Settings of a sensor file", _sensors),
    "end_to_end": ("What a cheaper dataset costs in the end", _end_to_end),
    "alternatives": ("What could be built otherwise", _alternatives),
    "same": ("What only changes speed", _same),
    "shortcuts": ("Only what a scene requires", _shortcuts),
}


def _table(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in (head, ["---"] * len(head), *rows))
