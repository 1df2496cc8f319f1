"""Grasp a manifest's objects with several hands from PyPI; print touch rates, minutes and memory: `make test-hands`."""

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import yaml

from benchmarks.timing import Table
from pipeline.errors import StoreError
from pipeline.formats.hand_file import load_hand
from pipeline.store.directory import DataDirectory
from pipeline.tables.touch_tables import ObjectTouches, joined, read_touches
from schemas.grasps import GRASPS
from stages.registry import DATASET

HERE = Path(__file__).parent
ENOUGH, HANDS = 60.0, 5
"""Per cent of successful touches, and how many hands must reach it."""


def main() -> None:
    """Run the stages of a dataset once per hand; exit with status 1 where a command fails, or too few hands touch enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("hands", nargs="*", default=sorted(path.stem for path in HERE.glob("*.yaml")), help="names of hand files here")
    parser.add_argument("--site-packages", type=Path, action="append", required=True, help="where the wheels are installed")
    parser.add_argument("--manifest", default="toy")
    parser.add_argument("--data", type=Path, default=Path("data/hands"))
    parser.add_argument("--set", action="append", default=[], help="settings, as `vt-pipeline run` takes them")
    parser.add_argument("--workers", default="0")
    options = parser.parse_args()
    options.data.mkdir(parents=True, exist_ok=True)
    columns = ["fingers", "sensors", "joints", "loaded in, s", "minutes", "peak, MB", "objects", "failed"]
    columns += ["% of touches", "% of attempts, mean over objects"]
    table, reached, failures = Table("Hands of others", columns), 0, list[str]()
    for name in options.hands:
        path = _installed(name, options.site_packages, options.data)
        began = time.perf_counter()
        hand = load_hand(path)
        seconds = round(time.perf_counter() - began, 1)
        began = time.perf_counter()
        try:
            touches, peak = _run(path, options.data / name, options)
        except subprocess.CalledProcessError as error:
            failures.append(f"{name}: {error}")
            print(failures[-1], flush=True)
            continue
        minutes = round((time.perf_counter() - began) / 60, 1)
        objects, share, tried = len(touches), "–", "–"
        if objects:
            success = 100 * float(joined(touches, "touched").mean())
            share, tried = f"{success:.1f}", f"{100 * np.mean([item.attempts for item in touches]):.1f}"
            reached += success >= ENOUGH
        failed = len(list(DataDirectory(options.data / name).collection(GRASPS))) - objects
        table.add(name, len(hand.fingers), len(hand.sensors), len(hand.joint_names), seconds, minutes, peak, objects, failed, share, tried)
    print(table.markdown(f"{reached} of {len(options.hands)} hands reach {ENOUGH:g} % of successful touches."))
    if failures:
        sys.exit("\n".join(failures))
    if len(options.hands) >= HANDS > reached:
        sys.exit(1)


def _run(hand: Path, data: Path, options: argparse.Namespace) -> tuple[Sequence[ObjectTouches], int]:
    """Check a hand, run the stages with it, and print the summary; return the touches of all objects and the peak memory, MB."""
    pipeline = [sys.executable, "-m", "pipeline"]
    peak = _peak([*pipeline, "check", str(hand)], cwd=data.parent)
    for stage in DATASET:
        settings = [f"{stage}.hand={hand}"] if stage in ("simulate-grasps", "render-vision") else []
        settings += [text for text in options.set if text.startswith(stage)]
        command = ["run", stage, "--manifest", options.manifest, "--data", str(data), "--workers", options.workers]
        peak = max(peak, _peak([*pipeline, *command, *(part for text in settings for part in ("--set", text))]))
    subprocess.run([*pipeline, "summary", str(data)], check=False)
    try:
        return read_touches(data).objects, peak
    except StoreError as error:
        print(f"{hand.stem}: {error}")
        return [], peak


def _peak(command: list[str], cwd: Path | None = None) -> int:
    """Run a command to its end, which must be success; return the peak memory of its largest process, MB."""
    process, peak = psutil.Popen(command, cwd=cwd), 0
    while process.poll() is None:
        with suppress(psutil.Error):
            peak = max([peak, *(member.memory_info().rss for member in (process, *process.children(recursive=True)))])
        time.sleep(0.1)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, " ".join(command))
    return round(peak / 1e6)


def _installed(name: str, folders: list[Path], data: Path) -> Path:
    """Write a hand file with the absolute path of its model."""
    described = yaml.safe_load((HERE / f"{name}.yaml").read_text())
    models = [folder / described["model"] for folder in folders if (folder / described["model"]).is_file()]
    if not models:
        sys.exit(f"{described['model']} is in none of {', '.join(map(str, folders))}; `make test-hands` installs it")
    path = (data / f"{name}.yaml").resolve()
    path.write_text(yaml.safe_dump(described | {"model": str(models[0].resolve())}))
    return path


if __name__ == "__main__":
    main()
