"""Compare the 400 grasps that DexGraspBench ships with ours of the same objects and hand: `python -m benchmarks.public_grasps PUBLIC`.

PUBLIC is a clone of JYChen18/DexGraspBench with its submodule. Both sets go through its own test, unchanged, in a copy that gets our grasps
too, and through our tests in two engines. `make bench-grasps PUBLIC=FOLDER` installs what its own test needs.
"""

import argparse
import csv
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.grasp_tests import Engine
from benchmarks.held_grasps import HoldResults, measure
from benchmarks.provenance import ROOT, provenance
from benchmarks.timing import Table, quantiles, three_digits, write_sections
from pipeline.formats.mjcf_files import import_mujoco
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS

PYTHON = ROOT / ".venv-peers-dexgraspbench" / "bin" / "python"
HAND = Path(__file__).with_suffix(".yaml")
PALM = "[0,0,0.034,1,0,0,0]"
"""The root link in the frame whose poses the files state, that of the MJCF's world."""
THEIRS, OURS = 20, 5
"""Grasps per object and scale."""
ENGINES: tuple[Engine, ...] = ("mujoco", "pybullet")
PIPELINE = (sys.executable, "-m", "pipeline")
NOTES = (
    f"Five objects at four scales (6 to 12 cm per unit of their files), the Shadow hand without forearm, {THEIRS} and {OURS} grasps each.",
    "DexGraspBench's are of BODex, which reports 49 grasps per second on a GPU, and over 75 % held with under 1 mm of penetration "
    "(Chen et al. 2024, with an object of 30 g; the test's is of 100 g).",
    "Ours are what `search=hold` keeps: held against the weight of 0.2 kg in PyBullet. The search does not know the test.",
    "Its own test is `task=eval` with its settings. It counts links within 2 mm, theirs with bare fingertips. Of ours the gels are rigid "
    "plates there, 2 mm before the fingertips: as far inside the object as it pressed the soft gels in. Our tests put gels on springs on "
    "the hand of both sets.",
    "DexGraspBench's own test is not run in PyBullet: there, fingers that close around a free object push it away.",
)


@dataclass(frozen=True, eq=False)
class GraspSet:
    """A set of grasps, and what the tests say: in PyBullet `lift` alone, where fingers that close around a free object push it away."""

    judged: list[list[dict[str, Any]]]  # by object, every grasp by the benchmark's own test
    held: HoldResults  # the first of each object, by ours
    penetration: np.ndarray  # of rigid links, all grasps, m
    seconds: float | None = None  # of one processor, that making one took

    def measured(self, name: str, each: int | None = None) -> np.ndarray:
        """Return what the benchmark's own test found of all grasps, or of the first of each object."""
        return np.array([grasp[name] for grasps in self.judged for grasp in grasps[:each]], float)

    @property
    def ends(self) -> list[float]:
        """Return the share of the first, and of the last grasps of all objects that hold in the benchmark's own test, %."""
        return [100 * float(np.mean([grasps[end]["succ_flag"] for grasps in self.judged])) for end in (0, -1)]

    @property
    def holds(self) -> np.ndarray:
        """Return the verdicts of the same test in MuJoCo here."""
        return self.held["dexgraspbench", "mujoco"][0]

    @property
    def own(self) -> np.ndarray:
        """Return the verdicts of the benchmark's own test on the same grasps."""
        return self.measured("succ_flag", len(self.holds) // len(self.judged))


def main() -> None:
    """Make both datasets, test them, print the table, and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.public_grasps", description=__doc__.splitlines()[0])
    parser.add_argument("public", type=Path, help="a clone of DexGraspBench with its submodule")
    parser.add_argument("--data", type=Path, default=Path("data/public-grasps"), help="what is made; default: %(default)s")
    parser.add_argument("--each", type=int, default=THEIRS, help="of an object at a scale that our tests take; default: %(default)s")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="objects at once; default: %(default)s")
    parser.add_argument("--write", type=Path, help="write the table into this page")
    options = parser.parse_args()
    bench, shipped, ours, exported = (options.data.resolve() / name for name in ("DexGraspBench", "shipped", "ours", "exported"))
    joints = prepare(options.public, bench)
    their_grasps = {"folder": bench / "output/example_shadow/graspdata", "joints": f"[{','.join(joints)}]", "root": PALM}
    make(shipped, bench, "read-grasps", options.workers, THEIRS, their_grasps)
    measures = not ours.exists()  # grasps that an earlier run made take no time
    seconds = make(ours, bench, "simulate-grasps", options.workers, OURS, {"search": "hold"})
    if not exported.exists():
        subprocess.run([*PIPELINE, "export", ours, exported, "--to", "dexgraspbench"], check=True)
        shutil.rmtree(bench / "assets/vt-pipeline", ignore_errors=True)  # of an earlier run
        shutil.copytree(exported, bench, dirs_exist_ok=True)
        for assets in (bench / "assets/vt-pipeline").iterdir():  # the same convex parts for both sets
            shutil.rmtree(assets)
            assets.symlink_to(bench / "assets/example_object" / assets.name.split("-scale")[0])
    sets = {
        "DexGraspBench's": judge(shipped, bench, "example", "shadow", options),
        "ours": judge(ours, bench, "vt-pipeline", "shadow_gels", options, seconds if measures else None),
    }
    origin = "`{command}` · commit {commit} · {machine} · {date}".format(**provenance("", "python -m benchmarks.public_grasps"))
    section = table(sets).markdown(origin)
    print(section)
    if options.write:
        write_sections(options.write, [section])


def prepare(public: Path, bench: Path) -> list[str]:
    """Copy the benchmark, with a hand file, and its objects at four scales as a manifest; return the hand's joints in its order."""
    shutil.copytree(public, bench, dirs_exist_ok=True, ignore=shutil.ignore_patterns(".git", "evaluation", "third_party"))
    hand, meshes = bench / "assets/hand/shadow", "third_party/mujoco_menagerie/shadow_hand/assets"
    shutil.copytree(public / meshes, bench / meshes, dirs_exist_ok=True)
    shutil.copytree(public / meshes, hand / "assets", dirs_exist_ok=True)
    mjcf = (hand / "right_hand.xml").read_text().replace(f"../../../{meshes}", "assets")
    (hand / "in_one_folder.xml").write_text(mjcf)
    shutil.copy(HAND, bench)
    rows = [["object_id", "category", "file", "up", "metres_per_unit"]]
    for scene in sorted((bench / "output/example_shadow/graspdata").glob("*/*")):
        name, scale = scene.parent.name, int(scene.name[len("scale") :][:3]) / 100
        rows.append([f"{name}-{scene.name}", name.split("_")[1], f"assets/example_object/{name}/mesh/simplified.obj", "y", str(scale)])
    with (bench / "catalogue.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    source = {"kind": "catalogue", "licence": "that of DexGraspNet's objects", "path": str(bench)}
    splits = {"train": 0, "valid": 0, "test": len(rows) - 1}
    manifest = {"name": "public-grasps", "description": "Five objects at four scales.", "seed": 0, "splits": splits, "sources": [source]}
    (bench / "objects.yaml").write_text(yaml.safe_dump(manifest))
    return [joint.name for joint in import_mujoco().MjSpec.from_file(str(hand / "in_one_folder.xml")).joints]


def make(data: Path, bench: Path, stage: str, workers: int, each: int, settings: dict[str, Any]) -> float:
    """Make the grasps of a dataset; return processor seconds per grasp, of a stage that has not run before."""
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    chosen = {"hand": bench / HAND.name, "grasps": each} | settings
    options = [part for name, value in chosen.items() for part in ("--set", f"{stage}.{name}={value}")]
    where: list[str | Path] = ["--manifest", bench / "objects.yaml", "--data", data, "--workers", str(workers)]
    subprocess.run([*PIPELINE, "run", "sample-surfaces", stage, *where, *options], check=True)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime) / (each * len(made(data)))


def made(data: Path) -> list[str]:
    """Name the objects with grasps."""
    grasps = DataDirectory(data).collection(GRASPS)
    return [name for name in grasps if grasps.failure(name) is None]


def judge(data: Path, bench: Path, output: str, hand: str, options: argparse.Namespace, seconds: float | None = None) -> GraspSet:
    """Test a dataset's grasps, which the benchmark has in a folder of its `output`, by its own test and by ours."""
    if not PYTHON.exists():
        raise RuntimeError(f"{PYTHON} is missing; `make bench-grasps PUBLIC=FOLDER` installs it")
    chosen = [f"exp_name={output}", f"hand={hand}", f"n_worker={options.workers}", "task.analytic_fc_metrics=null"]
    subprocess.run([PYTHON, "-W", "ignore", "src/main.py", "task=eval", *chosen], cwd=bench, check=True)
    evaluated = bench / "output" / f"{output}_{hand}" / "evaluation"
    scenes = [name.replace("-scale", "/scale") if output == "example" else f"{name}/scale_pose000" for name in made(data)]
    each = range(THEIRS if output == "example" else OURS)
    judged = [[np.load(evaluated / scene / f"{number}.npy", allow_pickle=True).item() for number in each] for scene in scenes]
    held = measure(data, ("dexgraspbench", "lift"), ("mujoco",), options.workers, options.each)
    held |= measure(data, ("lift",), ("pybullet",), options.workers, options.each)
    rows = map(DataDirectory(data).collection(GRASPS).view, made(data))
    return GraspSet(judged, held, np.concatenate([row["penetration"] for row in rows]), seconds)


def table(sets: Mapping[str, GraspSet]) -> Table:
    """Tabulate the sets."""
    result = Table("Grasps: DexGraspBench's examples", [*sets], NOTES)

    def add(name: str, of: Callable[[GraspSet], object]) -> None:
        result.add(name, *map(of, sets.values()))

    def lift(grasps: GraspSet, entry: int) -> list[float]:
        return [float(np.mean(grasps.held["lift", engine][entry])) for engine in ENGINES]

    add("grasps in its own test, in ours", lambda grasps: f"{grasps.measured('succ_flag').size}, {grasps.holds.size}")
    add("held in its own test, %", lambda grasps: f"{100 * grasps.measured('succ_flag').mean():.0f}")
    add(f"of the first {OURS} of each object", lambda grasps: f"{100 * grasps.measured('succ_flag', OURS).mean():.0f}")
    add("of the first and the last of each object", lambda grasps: ", ".join(f"{share:.0f}" for share in grasps.ends))
    add("of those that ours took", lambda grasps: f"{100 * grasps.own.mean():.0f}")
    add("held in that test here, in MuJoCo, %", lambda grasps: f"{100 * grasps.holds.mean():.0f}")
    add("same verdict in both, %", lambda grasps: f"{100 * np.mean(grasps.holds == grasps.own):.0f}")
    add("held against 0.2 kg: MuJoCo, PyBullet, %", lambda grasps: ", ".join(f"{100 * share:.0f}" for share in lift(grasps, 0)))
    add("rigid links inside the object, mm: median / 99 % / most", lambda grasps: quantiles(1e3 * grasps.penetration))
    add("at most 1 mm inside, %", lambda grasps: f"{100 * (grasps.penetration <= 1e-3).mean():.0f}")
    add("the same as its own test measures it, gels with links, mm", lambda grasps: quantiles(1e3 * grasps.measured("ho_pene")))
    add("links in contact", lambda grasps: f"{grasps.measured('contact_num').mean():.1f}")
    add("processor seconds to make a grasp", lambda grasps: three_digits(grasps.seconds) if grasps.seconds else "–")
    add("processor seconds of that test here", lambda grasps: three_digits(grasps.held["dexgraspbench", "mujoco"][1]))
    add("of that against 0.2 kg: MuJoCo, PyBullet", lambda grasps: ", ".join(map(three_digits, lift(grasps, 1))))
    return result


if __name__ == "__main__":
    main()
