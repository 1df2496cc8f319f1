"""Check advice: `python -m benchmarks.advice MANIFEST --budget 3min` (or `--error 5um`) follows it, and measures.

The stages are run as advised in a new directory. Their wall time is printed with the promised one, and so is the error of each,
measured against the most accurate settings on the same objects.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.tradeoff.errors import ERRORS
from benchmarks.tradeoff.runs import COMMON, MADE_BY, VT_PIPELINE, Made, command, link_common
from benchmarks.tradeoff.study_plan import StudyPlan, Variant, study_plans

PRESET = "standard"


def main() -> None:
    """Ask for advice, follow it, and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("--objects", help="as of `vt-pipeline advise`, like all other options")
    options, question = parser.parse_known_args()
    named = ["--objects", options.objects] if options.objects else []
    advice = _advice(["--manifest", str(options.manifest), *named, *question])
    more = ["--workers", "0", *named]  # on all cores, as advised
    with tempfile.TemporaryDirectory() as place:
        data, began = Path(place) / COMMON, time.perf_counter()
        for stage in advice["stages"]:
            command(stage, options.manifest, PRESET, data, advice["set"], more=more)
        took, promised = time.perf_counter() - began, advice["seconds"]
        print(f"{advice['command']}\n{advice['objects']} objects: promised {promised:.0f} s, took {took:.0f} s ({took / promised:.2f} x)")
        if "train-gcn" in advice["stages"]:
            command("evaluate", options.manifest, PRESET, data, ["evaluate.configurations=[touch]"], more=more)
        for stage, entry in advice["stages"].items():
            error = _error(stage, options.manifest, Path(place), advice["set"], more)
            promised = f"promised {entry['error']:.4g}, {entry['bound']:.4g} at most"
            print(f"{stage}, {entry['setting']}: {entry['metric']}: {promised}, is {error:.4g}")


def _advice(question: list[str]) -> dict[str, Any]:
    done = subprocess.run([VT_PIPELINE, "advise", *question, "--json"], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(done.returncode)
    advice: dict[str, Any] = json.loads(done.stdout)
    return advice


def _error(stage: str, manifest: Path, place: Path, settings: list[str], more: list[str]) -> float:
    """Measure the error of a stage's output, at the study's fixed settings, against its reference on the same inputs."""
    study = next(study for study in study_plans() if study.stage == stage)
    data, reference = place / COMMON, Path()
    fixed = Variant("preset", PRESET, PRESET, study.fixed).assignments(stage)
    if set(fixed) - set(settings):
        data = _beside(study, manifest, place, "asked-for", PRESET, [*settings, *fixed], more)
    if exact := study.reference_variant():
        reference = _beside(study, manifest, place, "reference", exact.preset, exact.assignments(stage), more, exact.seed)
    return ERRORS[stage](Made(data, 0.0, 0.0, {}), reference).error


def _beside(
    study: StudyPlan, manifest: Path, place: Path, name: str, preset: str, settings: list[str], more: list[str], seed: int | None = None
) -> Path:
    """Run a stage again, on the same inputs."""
    data = place / f"{study.stage}-{name}"
    link_common(place, data, MADE_BY[study.stage])
    command(study.stage, manifest, preset, data, settings, seed, more)
    return data


if __name__ == "__main__":
    main()
