"""`python -m benchmarks.big_run --manifest M --data D`: run the four dataset stages on Dask, and write tables of what they took.

Beside each stage, its processes are sampled: memory, processor time and open files, and what the data directory has grown to. With
`--tables` nothing is run: the tables are written of the samples that lie beside the data directory.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from benchmarks.big_run_tables import samples_beside, tables
from benchmarks.provenance import provenance

STAGES = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")
SECONDS = 10
"""Between two samples."""


def run_stage(stage: str, arguments: list[str], data: Path, log: Path) -> None:
    """Run a stage in a process of its own, and append a sample every few seconds to a file of JSON lines."""
    began = time.monotonic()
    with log.open("a", buffering=1) as file, subprocess.Popen([sys.executable, "-m", "pipeline", "run", stage, *arguments]) as process:
        status = None
        while status is None:
            with suppress(subprocess.TimeoutExpired):
                status = process.wait(SECONDS)
            sample = {"stage": stage, "seconds": time.monotonic() - began, "status": status, **size_of(data)}
            file.write(json.dumps(sample | processes_of(process.pid)) + "\n")
    if status:
        raise SystemExit(f"{stage} ended with status {status}")


def processes_of(pid: int) -> dict[str, Any]:
    """Measure a process and the workers below it: resident bytes, processor seconds, open files."""
    found: dict[int, tuple[int, float, int]] = {}
    with suppress(psutil.Error):
        for one in [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]:
            with suppress(psutil.Error):
                times = one.cpu_times()
                if one.pid == pid or "spawn_main" in "".join(one.cmdline()):
                    found[one.pid] = (one.memory_info().rss, times.user + times.system, one.num_fds())
    resident = {number: bytes_ for number, (bytes_, _, _) in found.items()}
    return {
        "main": resident.pop(pid, 0),
        "workers": resident,
        "cpu": sum(cpu for _, cpu, _ in found.values()),
        "open": sum(files for _, _, files in found.values()),
    }


def size_of(data: Path) -> dict[str, int]:
    """Count the bytes and files below a folder, while others write there."""
    sizes = []
    for folder, _, names in os.walk(data):  # which goes on where a folder has been moved
        for name in names:
            with suppress(OSError):
                sizes.append(os.stat(os.path.join(folder, name)).st_size)
    return {"bytes": sum(sizes), "files": len(sizes)}


def main() -> None:
    """Run all stages, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.big_run", description=__doc__)
    parser.add_argument("--manifest", default="pybullet-objects")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--objects", help="folder of meshes, for manifests that name none")
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--shards", type=int, default=4)
    parser.add_argument("--tables", action="store_true", help="run nothing, write the tables of the last run")
    given = parser.parse_args()
    log = samples_beside(given.data)
    if not given.tables:
        if given.data.exists():
            parser.error(f"{given.data} is there; a run that continues another takes less: name another --data, or delete it")
        given.data.mkdir(parents=True)
        log.unlink(missing_ok=True)
        arguments = ["--manifest", given.manifest, "--preset", given.preset, "--data", str(given.data)]
        arguments += ["--executor", "dask", "--workers", str(given.workers), "--shards", str(given.shards)]
        arguments += ["--objects", given.objects] if given.objects else []
        for stage in STAGES:
            run_stage(stage, arguments, given.data, log)
    samples = [json.loads(line) for line in log.read_text().splitlines()]
    origin = provenance("python -m benchmarks.big_run", "python -m benchmarks.big_run")
    print("\n".join([*(f"{name}: {value}" for name, value in origin.items()), *tables(given.data, samples, given.workers)]))


if __name__ == "__main__":
    main()
