"""Measure every setting that changes results: `python -m benchmarks.tradeoff [--only STUDY_OR_SECTION] [--root DATA]`.

Variants are runs of `vt-pipeline` in directories of their own, as many side by side as there are cores, each on one; a second
run makes only what is missing or stale. Ends with `docs/tradeoff.md`, its plots, and the figures that `vt-pipeline` quotes.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import asdict
from itertools import repeat
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.provenance import provenance
from benchmarks.tradeoff import runs
from benchmarks.tradeoff.alternatives import alternatives
from benchmarks.tradeoff.end_to_end import end_to_end
from benchmarks.tradeoff.errors import ERRORS, Errors
from benchmarks.tradeoff.figures import SECTIONS, read_figures, write_figures
from benchmarks.tradeoff.page import write_page
from benchmarks.tradeoff.same import same_results
from benchmarks.tradeoff.sensor_settings import sensor_settings
from benchmarks.tradeoff.shortcuts import measure_all
from benchmarks.tradeoff.study_plan import StudyPlan, Variant, study_plans
from pipeline.console import Meter, console_on
from pipeline.tradeoff.measurements import Measurement, load_studies

DATASET = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")
TOUCH_ONLY = ("sample-surfaces", "simulate-grasps", "simulate-touch")
LEARNING = ("train-unet", "fit-charts", "train-gcn")
TOUCH_NETWORK = "train-gcn.configuration=touch"
COMMON = {"few": ("standard", DATASET), "four": ("standard", TOUCH_ONLY), "learning": ("draft", (*DATASET, *LEARNING))}
"""Preset and stages of the common directory of each manifest."""
MANIFESTS_OF = {
    "same": {"few", "learning"},
    "end_to_end": set[str](),
    "alternatives": {"few"},
    "shortcuts": set[str](),
    "sensors": set[str](),
}
"""The common directories that each section reads."""
APART = ("sensors",)
"""Sections that are measured only where `--only` names them: they need the package taxim, which holds the photographs."""


def main() -> None:
    """Measure, and write what was measured."""
    plans = study_plans()
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--root", type=Path, default=Path("data/tradeoff"))
    parser.add_argument("--only", action="append", choices=[*(plan.name for plan in plans), *SECTIONS], help="the rest stays as it was")
    parser.add_argument("--page", action="store_true", help="only write the page and its plots")
    options = parser.parse_args()
    figures, asked = read_figures(), options.only or [*(plan.name for plan in plans), *(name for name in SECTIONS if name not in APART)]
    if not options.page:
        _measure(figures, [plan for plan in plans if plan.name in asked], [name for name in SECTIONS if name in asked], options.root)
    write_page(figures, load_studies().values())


def _measure(figures: dict[str, Any], plans: Sequence[StudyPlan], sections: Sequence[str], root: Path) -> None:
    """Measure studies and sections; each is written when it is done, so that a killed run keeps it."""
    console, made = console_on(sys.stdout), provenance("make tradeoff", "python -m benchmarks.tradeoff")
    for name in sorted({plan.objects for plan in plans}.union(*(MANIFESTS_OF[name] for name in sections))):
        preset, stages = COMMON[name]
        console.print(f"objects {name}: {', '.join(stages)}")
        runs.prepare(root, name, {stage: [TOUCH_NETWORK] if stage == "train-gcn" else [] for stage in stages}, preset)
    for plan in plans:
        study = runs.study(plan, made, _measurements(root, plan, console))
        studies = figures["studies"] | {plan.name: asdict(study)}
        figures["studies"] = {one.name: studies[one.name] for one in study_plans() if one.name in studies}
        write_figures(figures)
    for name in sections:
        figures["sections"][name] = {"provenance": made, "rows": _section(name, root, console)}
        write_figures(figures)


def _section(name: str, root: Path, console: Console) -> list[dict[str, Any]]:
    match name:
        case "same":
            return same_results(root, console)
        case "end_to_end":
            return end_to_end(root, console)
        case "alternatives":
            return alternatives(root / "few" / runs.COMMON)
        case "sensors":
            return sensor_settings()
        case _:
            return measure_all()


def _measurements(root: Path, plan: StudyPlan, console: Console) -> list[Measurement]:
    """Make a study's variants and measure them."""
    variants, reference = plan.variants(), plan.reference_variant()
    with Meter(console, plan.name, len(variants) + bool(reference), "settings") as meter, ThreadPoolExecutor(os.cpu_count()) as pool:

        def make(variant: Variant) -> runs.Made:
            made = runs.make(root, plan, variant)
            if plan.stage == "train-gcn":
                name = variant.settings(plan.stage).model_dump()["configuration"]
                runs.command("evaluate", plan.manifest, plan.base, made.data, [f"evaluate.configurations=[{name}]"])
            meter.advance(variant.label)
            return made

        exact = pool.submit(make, reference) if reference else None
        made = list(pool.map(make, variants))
        reference_data = exact.result().data if exact else Path()
    with ProcessPoolExecutor(os.cpu_count()) as processes:
        errors = list(processes.map(ERRORS[plan.stage], made, repeat(reference_data)))
    repeated = [
        error.error
        for variant, error in zip(variants, errors, strict=True)
        if variant.kind == "seed" or (variant.kind == "preset" and plan.base in variant.label.split(", "))
    ]
    return [_measurement(plan, *of, repeated) for of in zip(variants, made, errors, strict=True)]


def _measurement(plan: StudyPlan, variant: Variant, made: runs.Made, error: Errors, repeated: list[float]) -> Measurement:
    return Measurement(
        label=variant.label,
        kind=variant.kind,
        settings=variant.settings(plan.stage).accuracy(),
        seconds=round(made.seconds, 4),
        kilobytes=round(made.kilobytes, 2),
        figures={name: float(f"{value:.4g}") for name, value in error.figures.items()},
        bound=float(f"{error.bound(repeated):.4g}"),
    )


if __name__ == "__main__":
    main()
