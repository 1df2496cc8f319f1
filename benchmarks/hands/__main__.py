"""Grasp a manifest's objects with each of seven foreign hands, and print what comes of it: python -m benchmarks.hands --help."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import yaml

from pipeline.dataset.touch_statistics import Tally, tally
from pipeline.errors import StoreError
from pipeline.formats.hand_file import load_hand
from pipeline.reports.status import read_account

HERE = Path(__file__).parent
STAGES = ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")
ENOUGH, HANDS = 60.0, 5
"""Per cent of successful touches that as many hands must reach."""


def main() -> None:
    """Run the stages of a dataset once per hand; ends with status 1 where too few hands touch enough."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("hands", nargs="*", default=sorted(path.stem for path in HERE.glob("*.yaml")), help="names of hand files here")
    parser.add_argument("--site-packages", type=Path, action="append", required=True, help="where the wheels are installed")
    parser.add_argument("--manifest", default="toy")
    parser.add_argument("--data", type=Path, default=Path("data/hands"))
    parser.add_argument("--set", action="append", default=[], help="settings, as `vt-pipeline run` takes them")
    parser.add_argument("--workers", default="0")
    options = parser.parse_args()
    options.data.mkdir(parents=True, exist_ok=True)
    rows = [_row(name, options) for name in options.hands]
    print("\n| hand | fingers | sensors | joints | loaded in, s | objects | failed | % of touches | % of all attempts |")
    print("| --- " * 9 + "|")
    for row in rows:
        print("| " + " | ".join(map(str, row)) + " |")
    good = sum(isinstance(row[7], float) and row[7] >= ENOUGH for row in rows)
    print(f"{good} of {len(rows)} hands reach {ENOUGH:g} % of successful touches")
    if len(rows) >= HANDS > good:
        sys.exit(1)


def _row(name: str, options: argparse.Namespace) -> tuple[object, ...]:
    path = _installed(name, options.site_packages, options.data)
    began = time.perf_counter()
    hand = load_hand(path)
    seconds = time.perf_counter() - began
    data = options.data / name
    for stage in STAGES:
        settings = [f"hand={path}"] if stage in ("simulate-grasps", "render-vision") else []
        assignments = [part for one in (*settings, *(text for text in options.set if text.startswith(stage))) for part in ("--set", one)]
        command = [sys.executable, "-m", "pipeline", "run", stage, "--manifest", options.manifest, "--data", str(data)]
        subprocess.run([*command, "--workers", options.workers, *assignments], check=True)
    subprocess.run([sys.executable, "-m", "pipeline", "summary", str(data)], check=False)
    try:
        found = tally(data).values()
    except StoreError as error:
        print(f"{name}: {error}")
        found = []
    everything = Tally([t for entry in found for t in entry.touched], [t for entry in found for t in entry.tried])
    shares = tuple(round(share, 1) for share in everything.row()[3:]) if everything.touched else ("–", "–")
    objects = len(everything.touched)
    failed = _failed(data)
    return name, len(hand.fingers), len(hand.sensors), len(hand.joint_names), round(seconds, 1), objects, failed, *shares


def _failed(data: Path) -> int:
    return sum(len(entry.failures) for entry in read_account(data).artifacts if entry.artifact == "grasps")


def _installed(name: str, folders: list[Path], data: Path) -> Path:
    """Write a hand file with the absolute path of its URDF."""
    described = yaml.safe_load((HERE / f"{name}.yaml").read_text())
    found = [folder / described["urdf"] for folder in folders if (folder / described["urdf"]).is_file()]
    if not found:
        sys.exit(f"{described['urdf']} is in none of {', '.join(map(str, folders))}; `make test-hands` installs it")
    path = (data / f"{name}.yaml").resolve()
    path.write_text(yaml.safe_dump(described | {"urdf": str(found[0].resolve())}))
    return path


if __name__ == "__main__":
    main()
