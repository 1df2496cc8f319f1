"""Measure this checkout beside an earlier commit: `python -m benchmarks.before COMMIT [ROW …]`, or `make bench-before BEFORE=COMMIT`.

Both checkouts run the same commands in turns, in this environment, with one thread. Figures are the median processor seconds of the whole
process with its children, and the greatest resident memory of one of them; images and objects per command divide the seconds.
"""

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from benchmarks.provenance import ROOT, provenance
from benchmarks.timing import Table, three_digits

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "LP_NUM_THREADS")
TOY, HELD, LEARNED = "data/toy", "data/held", "data/learned"
"""Datasets below the folder that a checkout works in."""


def stage(name: str, data: str = TOY, *settings: str) -> str:
    """Write the command that runs a stage on the toy dataset."""
    options = " ".join(f"--set {setting}" for setting in settings)
    return f"vt-pipeline run {name} --manifest toy --data {data} --executor serial {options}"


@dataclass(frozen=True)
class Row:
    """A row of the table: what is measured, and the command that does it."""

    title: str
    command: str
    needs: Sequence[str] = ()  # commands that run first, untimed
    removes: str = ""  # what the command writes, removed before each run, with all that begins so
    items: int = 1  # that the seconds are divided by
    prints: bool = False  # the command prints the seconds itself, without its start


SURFACES, GRASPS, VISION, TOUCH = map(stage, ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch"))
DATASET = (SURFACES, GRASPS, VISION, TOUCH)
SMALL = stage("sample-surfaces", HELD, "sample-surfaces.diagonal=0.15")
TRAINING = "train-unet.width=2", "train-unet.epochs=1", "sample-distances.queries=6144"
LEARN = [stage(name, LEARNED, *TRAINING) for name in ("sample-surfaces", "simulate-grasps", "render-vision", "simulate-touch")]
LEARN += [stage(name, LEARNED, *TRAINING) for name in ("train-unet", "fit-charts", "sample-distances")]
EPOCHS = 20  # of an item for each of toy's 15 training objects
ANY = stage("train-implicit", LEARNED, "train-implicit.configuration=implicit-any", f"train-implicit.epochs={EPOCHS}")
NETWORKS = "none", "occluded-touch"
MEASURED = f"evaluate.configurations=[{','.join(NETWORKS)}]"
GCN = [stage("train-gcn", LEARNED, *TRAINING, "train-gcn.epochs=1", f"train-gcn.configuration={name}") for name in NETWORKS]
MAKE = f"make --no-print-directory dataset DATA={TOY} WORKERS=1 VENV=venv"


def many(count: int) -> dict[str, Row]:
    """Measure the stages that read a whole dataset, of `count` objects of which a fifth is evaluated, with two networks."""
    data = f"data/many-{count}"
    evaluate = f"vt-pipeline run evaluate --manifest {data}/many.yaml --data {data} --set {MEASURED}"
    needs = (*LEARN[:6], *GCN, f"python {ROOT / 'benchmarks' / 'many_objects.py'} {LEARNED} {count} {data}")
    return {
        f"evaluate-{count}": Row(f"evaluate, {count} objects", evaluate, needs, f"{data}/evaluation"),
        f"report-{count}": Row(f"report, {count} objects", f"vt-pipeline report {data}", (*needs, evaluate), f"{data}/report"),
    }


def image(kind: str, rows: int, columns: int) -> str:
    """Write the command that times images of a sensor of this size."""
    return f"python {ROOT / 'benchmarks' / 'gel_images.py'} {kind} {rows} {columns}"


ROWS = {
    "surfaces": Row("sample-surfaces, toy", SURFACES, removes=f"{TOY}/surfaces"),
    "grasps": Row("simulate-grasps, toy", GRASPS, DATASET[:1], f"{TOY}/grasps"),
    "vision": Row("render-vision, toy", VISION, DATASET[:2], f"{TOY}/vision"),
    "touch": Row("simulate-touch, toy", TOUCH, DATASET[:2], f"{TOY}/touch"),
    "current-surfaces": Row("sample-surfaces, up to date", SURFACES, DATASET[:1]),
    "current-grasps": Row("simulate-grasps, up to date", GRASPS, DATASET[:2]),
    "current-vision": Row("render-vision, up to date", VISION, DATASET[:3]),
    "current-touch": Row("simulate-touch, up to date", TOUCH, DATASET),
    "current": Row("make dataset, up to date", MAKE, (*DATASET, MAKE)),
    "hold": Row(
        "simulate-grasps, search=hold, per object of toy at 0.15 m",
        stage("simulate-grasps", HELD, "simulate-grasps.search=hold"),
        (SMALL,),
        f"{HELD}/grasps",
        items=25,
    ),
    "gel-64": Row("elastic gel, one image of 64 × 64", image("elastic", 64, 64), prints=True),
    "gel-320": Row("elastic gel, one image of 240 × 320", image("elastic", 240, 320), prints=True),
    "gel-640": Row("membrane and shadows, one image of 480 × 640", image("membrane", 480, 640), prints=True),
    "demo": Row("demo", "vt-pipeline demo data/demo", removes="data/demo"),
    "predict": Row("predict, pretrained", f"vt-pipeline predict data/mug.ply --data {LEARNED} --object mug --grasp 0", LEARN[:6]),
    "training": Row(f"train-implicit, implicit-any, one of {EPOCHS} epochs on toy", ANY, LEARN, f"{LEARNED}/models/implicit", items=EPOCHS),
    **many(240),
    **many(720),
    **many(2160),
}


@dataclass
class Checkout:
    """A checkout, the folder that its commands run in, and what they took by row."""

    root: Path
    folder: Path
    seconds: dict[str, list[float]] = field(default_factory=dict)
    megabytes: dict[str, list[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Link what the commands name in the folder: an environment that make takes for installed, and the Makefile with its files."""
        shutil.rmtree(self.folder / "venv", ignore_errors=True)
        (self.folder / "venv").mkdir(parents=True)
        for path in Path(sys.prefix).iterdir():
            if path.name != "installed":
                (self.folder / "venv" / path.name).symlink_to(path)
        for path in self.root.iterdir():
            if path.name not in (".git", "data") and not (self.folder / path.name).exists():
                (self.folder / path.name).symlink_to(path)
        (self.folder / "venv" / "installed").touch()

    def run(self, command: str) -> tuple[float, float, str]:
        """Run a command; return its processor seconds, its megabytes, and what it prints."""
        program, *arguments = shlex.split(command)
        python = {"vt-pipeline": [sys.executable, "-m", "pipeline"], "python": [sys.executable]}
        environment = os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": str(self.root), "PYTHONSAFEPATH": "1"}
        with tempfile.TemporaryFile("w+") as printed:
            process = subprocess.Popen(
                [*python.get(program, [program]), *arguments], cwd=self.folder, env=environment, stdout=printed, stderr=subprocess.STDOUT
            )
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            printed.seek(0)
            if process.returncode:
                raise SystemExit(f"{command}: in {self.folder}, with the code of {self.root}\n{printed.read()}")
            return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3, printed.read()

    def measure(self, name: str) -> None:
        """Run a row once."""
        row = ROWS[name]
        for path in self.folder.glob(f"{row.removes}*") if row.removes else ():  # with its record
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        seconds, megabytes, printed = self.run(row.command)
        self.seconds.setdefault(name, []).append((float(printed) if row.prints else seconds) / row.items)
        self.megabytes.setdefault(name, []).append(megabytes)


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """Check a commit out beside this one, in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", f"{folder}/checkout", commit], check=True)
        try:
            yield Path(folder, "checkout")
        finally:
            subprocess.run([*git, "remove", "--force", f"{folder}/checkout"], check=True)


def compare(before: Checkout, now: Checkout, names: Sequence[str], rounds: int) -> Table:
    """Run the rows in turns."""
    table = Table("Beside an earlier commit", ["s before", "s now", "now ÷ before", "MB before", "MB now"])
    for name in names:
        for command in ROWS[name].needs:
            for checkout in (before, now):
                checkout.run(command)
        for turn in range(rounds):
            for checkout in (before, now)[:: 1 if turn % 2 else -1]:
                checkout.measure(name)
        was, seconds = (median(checkout.seconds[name]) for checkout in (before, now))
        memory = [f"{median(checkout.megabytes[name]):.0f}" for checkout in (before, now)]
        table.add(ROWS[name].title, three_digits(was), three_digits(seconds), f"{seconds / was:.2f}", *memory)
        print(" | ".join(table.rows[-1]), file=sys.stderr, flush=True)
    return table


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.before", description=__doc__)
    parser.add_argument("commit", help="what this checkout is compared with")
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"all unless given: {', '.join(ROWS)}")
    parser.add_argument("--rounds", type=int, default=5, help="runs of each command in each checkout; 5 unless given")
    parser.add_argument("--data", type=Path, help="folder to keep the datasets in, for the next time; a temporary one unless given")
    parser.add_argument("--write", type=Path, help="write the table to this page")
    arguments = parser.parse_args()
    if unknown := set(arguments.rows) - set(ROWS):
        parser.error(f"there is no row {', '.join(sorted(unknown))}; there are {', '.join(ROWS)}")
    origin = "`{command}` · commit {commit} · {machine} · {date}".format(**provenance("", "python -m benchmarks.before"))
    with checked_out(arguments.commit) as root, tempfile.TemporaryDirectory() as folder:
        data = (arguments.data or Path(folder)).absolute()
        table = compare(Checkout(root, data / "before"), Checkout(ROOT, data / "now"), arguments.rows or list(ROWS), arguments.rounds)
    text = table.markdown(origin)
    print(text)
    if arguments.write:
        arguments.write.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
