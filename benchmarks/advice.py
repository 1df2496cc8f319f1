"""Whether advice holds: `python -m benchmarks.advice MANIFEST --budget 3min` (or `--error 5um`) takes it, and measures.

The stages are run as advised into a new directory; their wall time stands beside the promised one, and the error of each, against
the most accurate settings on the same objects, beside the promised one.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.tradeoff.errors import ERRORS
from benchmarks.tradeoff.variants import studies
from benchmarks.tradeoff.work import MADE_BY, VT_PIPELINE, Made, link_common


def main() -> None:
    """Ask, do, and compare."""
    manifest, *question = sys.argv[1:]
    advice = json.loads(_output([VT_PIPELINE, "advise", "--manifest", manifest, *question, "--json"]))
    settings = [part for line in advice["set"] for part in ("--set", line)]
    with tempfile.TemporaryDirectory() as place:
        data, began = Path(place) / "common", time.perf_counter()
        for stage in advice["stages"]:
            _output([VT_PIPELINE, "run", stage, "--manifest", manifest, "--preset", "standard", "--data", str(data), *settings])
        took, promised = time.perf_counter() - began, advice["seconds"]
        print(f"{advice['command']}\n{advice['objects']} objects: promised {promised:.0f} s, took {took:.0f} s ({took / promised:.2f} x)")
        if "train-gcn" in advice["stages"]:
            line = [VT_PIPELINE, "run", "evaluate", "--manifest", manifest, "--data", str(data), "--set", "evaluate.configurations=[touch]"]
            _output(line)
        for stage, entry in advice["stages"].items():
            error = _error(stage, manifest, Path(place), data)
            promised = f"promised {entry['error']:.4g}, {entry['bound']:.4g} at most"
            print(f"{stage}, {entry['setting']}: {entry['metric']}: {promised}, is {error:.4g}")


def _error(stage: str, manifest: str, place: Path, data: Path) -> float:
    """The error of a stage's output, against its reference made from the same inputs."""
    study = next(study for study in studies() if study.stage == stage)
    reference = place / f"{stage}-reference"
    if exact := study.against():
        link_common(place, reference, MADE_BY[stage])
        values = [part for line in exact.assignments(stage) for part in ("--set", line)]
        line = [VT_PIPELINE, "run", stage, "--manifest", manifest, "--preset", exact.preset, "--data", str(reference)]
        _output([*line, "--seed", str(exact.seed), *values])
    return ERRORS[stage](Made(data, 0.0, 0.0, {}), reference).error


def _output(line: list[str]) -> str:
    """What a command prints; its error ends this one too."""
    done = subprocess.run(line, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(done.returncode)
    return done.stdout


if __name__ == "__main__":
    main()
