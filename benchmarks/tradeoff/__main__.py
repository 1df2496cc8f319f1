"""Every setting that changes results against its cost: `python -m benchmarks.tradeoff [--only STUDY_OR_SECTION] [--root DATA]`.

Variants are runs of `vt-pipeline` in directories of their own, as many side by side as there are cores, each on one; a second
run makes only what is missing or stale. Ends with `docs/tradeoff.md`, its plots, and the figures that `vt-pipeline` itself reads.
"""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import repeat
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.tradeoff import work
from benchmarks.tradeoff.alternatives import alternatives
from benchmarks.tradeoff.end_to_end import end_to_end
from benchmarks.tradeoff.errors import ERRORS, Errors
from benchmarks.tradeoff.same import same_results
from benchmarks.tradeoff.shortcuts import measure as measure_shortcuts
from benchmarks.tradeoff.variants import Study, Variant, studies
from benchmarks.tradeoff.write import SECTIONS, read_asset, stamp, write_asset, write_page
from pipeline.console import Meter, console_on

DATASET = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")
FELT = ("sample-surfaces", "simulate-grasps", "simulate-touch")
LEARNING = ("train-unet", "fit-charts", "train-gcn")
TOUCH = "train-gcn.configuration=touch"
LOOKED_AT: dict[str, set[str]] = {"same": {"few", "learning"}, "end_to_end": set(), "alternatives": {"few"}, "shortcuts": set()}
"""The common directories that a section beside the studies looks into."""


def main() -> None:
    """Measure, and write what was measured."""
    everything = [*(study.name for study in studies()), *SECTIONS]
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--root", type=Path, default=Path("data/tradeoff"))
    parser.add_argument("--only", action="append", choices=everything, help="again; the rest stays as it was")
    parser.add_argument("--page", action="store_true", help="only write the page and its plots anew")
    options = parser.parse_args()
    console = console_on(sys.stdout)
    found = read_asset()
    if not options.page:
        made, asked = stamp(), options.only or everything
        chosen = [study for study in studies() if study.name in asked]
        _prepare(options.root, {study.objects for study in chosen}.union(*(LOOKED_AT[name] for name in SECTIONS if name in asked)), console)
        for study in chosen:  # written one by one: a killed run keeps what it has measured
            trades = found["trades"] | {study.name: _trade(options.root, study, console)}
            found["trades"] = {one.name: trades[one.name] for one in studies() if one.name in trades}
            found["made"][study.name] = made
            write_asset(found)
        for name in SECTIONS:
            if name in asked:
                found[name] = _section(name, options.root, console)
                found["made"][name] = made
                write_asset(found)
    write_page(found)


def _section(name: str, root: Path, console: Console) -> list[dict[str, Any]]:
    """What is measured beside the studies."""
    match name:
        case "same":
            return same_results(root, console)
        case "end_to_end":
            return end_to_end(root, console)
        case "alternatives":
            return alternatives(root / "few" / work.COMMON)
        case _:
            return [vars(shortcut) for shortcut in measure_shortcuts()]


def _prepare(root: Path, objects: set[str], console: Console) -> None:
    """The common directories of some objects."""
    wanted = {"few": ("standard", DATASET), "four": ("standard", FELT), "learning": ("draft", (*DATASET, *LEARNING))}
    for name, (preset, steps) in wanted.items():
        if name in objects:
            console.print(f"objects {name}: {', '.join(steps)}")
            work.prepare(root, name, {step: [TOUCH] if step == "train-gcn" else [] for step in steps}, preset)


def _trade(root: Path, study: Study, console: Console) -> dict[str, Any]:
    """Make a study's variants and measure them."""
    variants, against = study.variants(), study.against()
    with Meter(console, study.name, len(variants) + bool(against), "settings") as meter, ThreadPoolExecutor(os.cpu_count()) as pool:

        def one(variant: Variant) -> work.Made:
            made = work.make(root, study, variant)
            if study.stage == "train-gcn":
                name = variant.settings(study.stage).model_dump()["configuration"]
                work.command("evaluate", study.manifest, study.base, made.data, [f"evaluate.configurations=[{name}]"])
            meter.advance(variant.label)
            return made

        exact = pool.submit(one, against) if against else None
        made = list(pool.map(one, variants))
        reference = exact.result().data if exact else Path()
    with ProcessPoolExecutor(os.cpu_count()) as processes:
        errors = list(processes.map(ERRORS[study.stage], made, repeat(reference)))
    again = [error.error for variant, error in zip(variants, errors, strict=True) if variant.kind == "seed" or _is_base(study, variant)]
    points = [_point(study, *of, again) for of in zip(variants, made, errors, strict=True)]
    described = {"costs": study.costs, "skipped": dict(study.skip), "always": dict(study.always), "beside": dict(study.beside)}
    return {"stage": study.stage, **work.extent(study), **described, "points": points}


def _is_base(study: Study, variant: Variant) -> bool:
    return variant.kind == "preset" and study.base in variant.label.split(", ")


def _point(study: Study, variant: Variant, made: work.Made, error: Errors, seeds: list[float]) -> dict[str, Any]:
    return {
        "label": variant.label,
        "kind": variant.kind,
        "settings": variant.settings(study.stage).accuracy(),
        "seconds": round(made.seconds, 4),
        "kilobytes": round(made.kilobytes, 2),
        "figures": {name: float(f"{value:.4g}") for name, value in error.figures.items()},
        "bound": float(f"{error.bound(seeds):.4g}"),
    }


if __name__ == "__main__":
    main()
