"""Write the report, a folder of static pages that open from a disk: overview, gallery, objects, figures, results and origin."""

import hashlib
import re
import shutil
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from numpy.typing import ArrayLike
from rich.console import Console

import pipeline
from pipeline.console import Meter, Row, Table, abbreviate, pluralise, visible
from pipeline.contrib.report.figures import CANDIDATES, clearest_grasp, draw_figures, overview_panels, save_picture
from pipeline.contrib.report.object_page import ObjectCard, ObjectPages, Pages
from pipeline.contrib.report.plots import draw_bars, draw_curves, draw_errors, draw_histogram
from pipeline.contrib.report.provenance import commands, contents_table, outside_sweeps, records, settings_tables, versions_tables
from pipeline.contrib.report.report_source import Picture, ReportSource
from pipeline.contrib.report.results import GIVEN, summarise, trained_models, training_losses
from pipeline.drawing.picture_sheet import spread_evenly
from pipeline.drawing.written_files import WRITTEN, read_list, refuse_links
from pipeline.engine.keys import sources_hash
from pipeline.errors import StoreError
from pipeline.physics.hold_test import REST, WITHIN
from pipeline.store import digest
from pipeline.store.atomic import atomic_writes
from pipeline.store.digest import hashes_of
from pipeline.store.directory import changed_files
from pipeline.store.record import Failure
from pipeline.store.storage import Location, exists, remove
from pipeline.tables.supplement_figures import PAPER
from pipeline.tables.touch_tables import ObjectTouches, joined, sequence_tables, touch_tables
from pipeline.tradeoff.trade_pictures import draw_trade
from pipeline.tradeoff.trades import END_TO_END, MeasuredTrade, Point, read_trade
from stages.registry import TRADED, resolve

ASSETS = Path(pipeline.__file__).parent / "assets" / "report"
COPIED = ("style.css", "viewer.js", "gallery.js", "tables.js", "three.min.js", "three.LICENSE")
PAGES = {"index.html": "Overview", "gallery.html": "Gallery", "figures.html": "Figures", "results.html": "Results", "about.html": "About"}
UNITS = "mm²|mm|µm|m²|m|grasps?|kB"  # units that are kept on the line of their number
WHICH_NETWORK = ("configuration", "training_seed")  # settings that say which network is trained, not how
FROM_INPUTS = ("hand", "sensors")  # settings that stages take from the grasps where they are null
CARDS = 8  # objects on the first page


def write_report(source: ReportSource, console: Console, max_objects: int = 10) -> Location:
    """Write a report into the folder `report` of the data directory, with at most `max_objects` reconstructions in a figure.

    Pages of objects that are up to date are kept. Returns its first page.
    """
    report = source.directory.root / "report"
    refuse_links(report)
    try:
        before = read_list(report / WRITTEN, Pages)
    except StoreError:  # there is none, or it is damaged
        before = Pages(files={}, objects={})
    with atomic_writes(report) as folder:
        (folder / "objects").mkdir()
        (folder / "figures").mkdir()
        for name in COPIED:
            shutil.copyfile(ASSETS / name, folder / name)
        figures = draw_figures(source, folder / "figures", max_objects)  # first, as models that cannot be used end the report
        objects = _write_objects(source, folder, console, before, changed_files(report, before.files))
        cards = [{"id": name, **card.model_dump()} for name, card in objects.items()]

        def write(name: str, **content: Any) -> None:
            common = {"up": "", "current": PAGES[name], "name": source.name, "pages": PAGES}
            page = _environment().get_template(f"{name}.j2").render(**common, **content)
            (folder / name).write_text(page, encoding="utf-8")

        write(
            "index.html",
            hero=_overview(source, folder),
            cards=spread_evenly(cards, CARDS),
            tables=[*touch_tables(source.results.touches), *sequence_tables(source.directory.root)],
            plots=_plots(source, objects, folder),
            tiles=_tiles(source),
            objects=len(objects),
            evaluated=source.evaluation is not None,
            has_images="vision" in source.collections,
        )
        categories, splits = (sorted({card[key] for card in cards}) for key in ("category", "split"))
        write("gallery.html", cards=cards, categories=categories, splits=splits)
        write("figures.html", figures=figures)
        write("results.html", **_results(source, folder), trades=_trades(source, folder))
        origins = records(source.directory)
        write(
            "about.html",
            failures=_failures(source.failures),
            contents=contents_table(origins),
            commands=commands(source.directory, origins),
            settings=settings_tables(source.directory, origins),
            versions=versions_tables(origins),
        )
        kept = [name for name, card in objects.items() if card is before.objects.get(name)]
        kept_files = {path: sha256 for name in kept for path, sha256 in before.files_of(name).items()}
        pages = Pages(objects=objects, files=kept_files | hashes_of(folder))
        (folder / WRITTEN).write_text(pages.model_dump_json())
        for obsolete in before.files.keys() - pages.files.keys():
            if exists(report / obsolete):
                remove(report / obsolete)
    return report / "index.html"


def _write_objects(source: ReportSource, folder: Path, console: Console, previous: Pages, changed: Container[str]) -> dict[str, ObjectCard]:
    """Write the pages of objects that changed since the last report, or whose report files changed; return the cards of all objects."""
    template = _environment().get_template("object.html.j2")
    common: dict[str, Any] = {"up": "../", "current": "", "name": source.name, "pages": PAGES}
    shared_hashes = [sources_hash(__name__), *(hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(ASSETS.iterdir()))]
    evaluated = [source.directory.folder(name).files for name in source.measured]
    ids, cards = source.object_ids, {}
    with Meter(console, "report", len(ids), "objects") as meter, ExitStack() as opened:
        pages = ObjectPages(source, template, folder / "objects", opened)
        for object_id, before, after in zip(ids, [None, *ids[:-1]], [*ids[1:], None], strict=True):
            split = source.collections["surfaces"].row(object_id).split  # which no digest contains
            key = digest.of_json([shared_hashes, evaluated, source.digests(object_id), split, before, after, common["name"]])
            card = previous.objects.get(object_id)
            if card is None or card.key != key or any(path in changed for path in previous.files_of(object_id)):
                card = pages.write(object_id, key, common | {"before": before, "after": after})
            cards[object_id] = card
            meter.advance()
    return cards


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(ASSETS), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_escaped
    )
    environment.filters["units"] = _with_units
    return environment


def _with_units(text: str) -> Markup:
    """Keep a number and its unit on one line."""
    return Markup(re.sub(rf"(?<=[0-9]) (?=(?:{UNITS})\b|[%°×])", "&nbsp;", str(escape(visible(text)))))


def _escaped(value: Any) -> Any:
    """Show the control characters of names and reasons as codes, so that a browser does not obey them."""
    return value if not isinstance(value, str) or hasattr(value, "__html__") or value.isprintable() else visible(value)


def _tiles(source: ReportSource) -> list[tuple[str, str]]:
    """Count objects, grasps, touches, failures, and grasps that hold where that was tested, for the first page."""
    touched, held = (joined(source.results.touches.objects, name) for name in ("touched", "held"))
    hold_tiles = [(f"{100 * held.mean():.0f} %", "of grasps hold the object")] if held.size else []
    return [
        _counted(len(source.object_ids), "object", " without failures" if source.failures else ""),
        _counted(len(source.results.touches.by_class), "class"),
        _counted(len(touched), "grasp"),
        _counted(int(touched.sum()), "touch", f", {100 * touched.mean():.0f} % of {touched.size}"),
        *hold_tiles,
        _counted(len(source.failures), "failure"),
    ]


def _counted(number: int, noun: str, share: str = "") -> tuple[str, str]:
    """Make a tile: a number, and what it counts."""
    return str(number), pluralise(number, noun).partition(" ")[2] + share


def _overview(source: ReportSource, folder: Path) -> dict[str, Any]:
    """Draw the pictures of the first page, of an object from the better half of the evaluated ones, if there are any."""
    ranked = source.evaluation.ranked(source.evaluation.configurations) if source.evaluation else []
    reconstructed = [name for name in ranked if name in source.object_ids]
    candidates = spread_evenly(reconstructed[: -(-len(reconstructed) // 2)] or source.object_ids, CANDIDATES)
    object_id, grasp = clearest_grasp(source, candidates, 1 if reconstructed else None)  # reconstructions with one grasp are of the first
    pictures = []
    for number, (caption, image) in enumerate(overview_panels(source, object_id, grasp), start=1):
        pictures.append(save_picture(image, folder / "figures", f"overview-{number}.webp", f"{object_id}: {caption}", caption))
    return {"object_id": object_id, "grasp": grasp + 1, "pictures": pictures, "columns": min(3, len(pictures))}


def _plots(source: ReportSource, objects: Mapping[str, ObjectCard], folder: Path) -> list[Picture]:
    """Draw the touches per grasp, beside the paper's if these are to be compared, and the contact areas by class."""
    shares, theirs = source.results.touches.per_grasp, source.results.touches.supplement_per_grasp
    bars: Mapping[str, ArrayLike] = {"here": shares} | ({PAPER: theirs} if theirs else {})
    draw_bars(folder / "figures" / "touches.svg", bars, range(len(shares)), x="touches per grasp", y="% of grasps")
    areas = {
        category: 1e6 * np.concatenate([card.areas for card in objects.values() if card.category == category])
        for category in sorted({card.category for card in objects.values()})
    }
    draw_histogram(folder / "figures" / "contact.svg", areas, x="contact area per touch, mm²", y="% of touches")
    means = ", ".join(f"{name} {values.mean():.0f}" for name, values in areas.items() if len(values))
    shares_text = ", ".join(f"{count}: {share:.1f} %" for count, share in enumerate(shares))
    return [
        Picture("figures/touches.svg", f"Touches per grasp here: {shares_text}", "Successful touches per grasp"),
        Picture("figures/contact.svg", f"Mean contact area, mm²: {means}", f"Contact area; mean, mm²: {means}"),
        *_hold_plots(source.results.touches.objects, folder / "figures"),
    ]


def _hold_plots(objects: Sequence[ObjectTouches], folder: Path) -> list[Picture]:
    """Draw how far and how fast objects moved at the end of the hold test, beside the limits of what holds; none if not tested."""
    measured = 1e3 * joined(objects, "motions").reshape(-1, 2).T
    if not measured.size:
        return []
    plots = []
    for name, unit, limit, values in (("distance", "mm", 1e3 * WITHIN, measured[0]), ("speed", "mm/s", 1e3 * REST, measured[1])):
        file, held, beyond = f"hold-{name}.svg", values[values <= limit], values[values > limit]
        draw_histogram(folder / file, {"kept grasps": values}, x=f"{name}, {unit}", y="% of hold tests", limit=limit)
        ends = [f"{len(held)} of {len(values)} up to {limit:g} {unit}", *([f"greatest {held.max():.3g}"] if len(held) else [])]
        ends += [f"least beyond {beyond.min():.3g} {unit}"] if len(beyond) else []
        caption = f"The object's {name} at the end of the hold test: {', '.join(ends)}"
        plots.append(Picture(f"figures/{file}", caption, caption))
    return plots


def _results(source: ReportSource, folder: Path) -> dict[str, Any]:
    """Make the summary and the tables of the evaluations, and the figures of the learning curves."""
    directory, tables, curves = source.directory, source.results.tables, []
    for name, model in trained_models(directory, source.results.evaluated).items():
        file = f"figures/learning-{name}.svg"
        draw_curves(*training_losses(directory.verified_folder(model)), folder / file)
        curves.append(Picture(file, f"Training and validation loss of {name} by epoch", name))
    return {"summary": _summary(source, folder), "tables": tables, "curves": curves}


def _summary(source: ReportSource, folder: Path) -> dict[str, Any] | None:
    """Summarise the results, and draw the error by what networks are given."""
    names = (source.results.evaluated, source.results.scored)
    evaluated, scored = ([source.directory.verified_folder(name) for name in part] for part in names)
    folders = [*evaluated[:1], *scored]
    if not folders or (summary := summarise(folders[0], folders[1:], evaluated[1:])) is None:
        return None
    file = "figures/errors.svg"
    draw_errors(folder / file, summary.errors, summary.retrieved, GIVEN, "mean distance, mm")
    series_texts = [
        f"{series}: {', '.join(f'{way} {error.mean:.1f}' for way, error in of_series.items())}"
        for series, of_series in summary.errors.items()
    ]
    over = "objects and trainings" if len(evaluated) > 1 else "objects"
    caption = f"Error with one grasp by what is given, with 95 % intervals over {over}."
    return {"sentences": summary.sentences, "picture": Picture(file, f"Mean distance, mm: {'; '.join(series_texts)}", caption)}


def _trades(source: ReportSource, folder: Path) -> list[Picture]:
    """Draw the measured trades of speed for accuracy, the used settings marked, if the data directory is on a disk."""
    if not isinstance(source.directory.root, Path):
        return []
    settings = {origin.stage: origin.settings for origin in outside_sweeps(records(source.directory)).values()}
    pictures = []
    for trade in filter(None, [read_trade(source.directory.root, name) for name in (*TRADED, END_TO_END)]):
        used = used_point(trade, settings[trade.stage]) if trade.stage in settings else None
        file = f"figures/trade-{trade.stage}.svg"
        draw_trade(trade, folder / file, used)
        points = "; ".join(f"{point.label}: {point.seconds:.3g} s, {point.error:.3g} {trade.unit}".strip() for point in trade.points)
        mark = f"; used here: {used.label}" if used else "; the settings used here were not measured" if trade.stage in settings else ""
        caption = f"{trade.stage}, on {pluralise(len(trade.objects))}{mark}."
        pictures.append(Picture(file, f"{trade.metric}: {points}", caption))
    return pictures


def used_point(trade: MeasuredTrade, settings: Mapping[str, Any]) -> Point | None:
    """Find the point with the settings that the record of the stage's output names; None where they were not measured."""
    own = resolve(trade.stage, trade.preset, trade.assignments).results()
    base = {name: value for name, value in own.items() if name not in WHICH_NETWORK and (value is not None or name not in FROM_INPUTS)}
    return next((point for point in trade.points if all(settings.get(k) == v for k, v in {**base, **point.changes}.items())), None)


def _failures(failures: Mapping[str, Failure]) -> Table:
    rows = []
    for why, count in Counter(failures.values()).most_common():
        rows.append(Row([why.stage, why.reason, str(count), abbreviate([name for name, other in failures.items() if other == why])]))
    return Table("", ["stage", "reason", "objects", "which"], rows)
