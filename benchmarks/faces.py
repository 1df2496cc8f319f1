"""Measure time and memory of the dataset's stages over the number of faces of an object: `python -m benchmarks.faces [--write PAGE]`.

The object is a torus of 0.5 m, twice, each stage in a process of its own; the faster of the two counts, and the process's peak memory.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import trimesh

from benchmarks.provenance import ROOT, provenance
from benchmarks.timing import Table, three_digits
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS

STAGES = {"sample-surfaces": "surfaces", "simulate-grasps": "grasps", "render-vision": "vision", "simulate-touch": "touch"}
SECTIONS = {2: (10, 5), 3: (50, 10), 4: (100, 50), 5: (500, 100), 6: (1000, 500)}
"""Sections of the torus around its axis and of its tube, by the power of ten that is the number of its faces."""
BEGIN, END = "<!-- faces -->\n", "<!-- /faces -->\n"
"""Lines of a page before and after the table."""


def measure(power: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Measure seconds per object and megabytes of each stage, for objects of 10^power faces."""
    meshes, data = folder / "meshes", folder / "data"
    meshes.mkdir()
    around, tube = SECTIONS[power]
    for name in ("a", "b"):
        trimesh.creation.torus(0.15, 0.05, major_sections=around, minor_sections=tube).export(meshes / f"{name}.ply")
    options = ["--manifest", "directory", "--objects", str(meshes), "--data", str(data), "--executor", "serial"]
    measured = {}
    for stage, artifact in STAGES.items():
        command = [sys.executable, "-m", "pipeline", "run", stage, *options, "--strict", "--set", "sample-surfaces.max_faces=2000000"]
        process = subprocess.Popen(command, cwd=ROOT, env=os.environ | {"OMP_NUM_THREADS": "1"}, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{stage} failed with 10^{power} faces")
        rows = DataDirectory(data).collection(ARTIFACTS[artifact]).first.record.rows
        measured[stage] = min(row.seconds for row in rows), usage.ru_maxrss / 1e3
        print(10**power, stage, json.dumps(measured[stage]), file=sys.stderr, flush=True)
    return measured


def table(measured: dict[int, dict[str, tuple[float, float]]]) -> str:
    """Format seconds and megabytes by stage and number of faces, with the slopes of the last two decades."""
    powers = sorted(measured)
    result = Table("Size of an object", [*(f"10^{power}" for power in powers), "slope"], [])
    for stage in STAGES:
        for number, unit in enumerate(("s", "MB")):
            values = [measured[power][stage][number] for power in powers]
            slope = math.log10(values[-1] / values[-3]) / 2
            result.add(f"`{stage}`, {unit}", *map(three_digits, values), f"{slope:.2f}")
    return "\n".join(result.markdown("").splitlines()[4:])


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faces", description=__doc__)
    parser.add_argument("--write", type=Path, help="write the table between the marks of this page")
    arguments = parser.parse_args()
    measured = {}
    for power in SECTIONS:
        with tempfile.TemporaryDirectory() as folder:
            measured[power] = measure(power, Path(folder))
    origin = "`{command}`, commit {commit}, {machine}, {date}.".format(
        **provenance("python -m benchmarks.faces", "python -m benchmarks.faces")
    )
    text = f"{table(measured)}\n\n{origin}\n"
    print(text)
    if arguments.write:
        before, _, rest = arguments.write.read_text(encoding="utf-8").partition(BEGIN)
        arguments.write.write_text(f"{before}{BEGIN}{text}{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
