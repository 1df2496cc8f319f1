"""Damage to files of a finished or unfinished dataset."""

import contextlib
import io
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from checks.faults.trial import Trial, Verdict, problems_in
from checks.forked import OK
from pipeline.console import console_on
from pipeline.tables import status


def kind_of(path: Path, data: Path) -> str:
    """Classify a file of a data directory."""
    parts = path.relative_to(data).parts
    if parts[0] == ".work":
        return "unfinished piece"
    if "tensorboard" in parts:
        return "training log"
    if path.name == "dataset.json" or (path.suffix == ".json" and path.with_suffix("").name.count("-of-")):
        return "record of a shard" if path.name != "dataset.json" else "dataset.json"
    if parts[0] in ("models", "evaluation.json") and path.suffix == ".json" and "-" not in path.parent.name:
        return "record of a folder"
    if parts[0] == "models" or parts[0].startswith("evaluation"):
        return "file of a model or evaluation"
    return "metadata of an array" if path.name == "zarr.json" else "chunks of an array"


def _delete(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.unlink()


def _empty(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.write_bytes(b"")


def _truncate(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    os.truncate(path, int(rng.integers(path.stat().st_size)))


def _flip(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    content = bytearray(path.read_bytes())
    content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    path.write_bytes(content)


def _zeros(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def _swap(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    other = others[rng.integers(len(others))]
    mine, theirs = path.read_bytes(), other.read_bytes()
    path.write_bytes(theirs)
    other.write_bytes(mine)


def _folder(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.unlink()
    path.mkdir()


Damage = Callable[[Path, np.random.Generator, list[Path]], None]

DAMAGES: dict[str, Damage] = {
    "deleted": _delete,
    "empty": _empty,
    "cut short": _truncate,
    "one bit flipped": _flip,
    "all zeros": _zeros,
    "swapped with another of its kind": _swap,
    "a folder in its place": _folder,
}


def damaged(trial: Trial, damages: Mapping[str, Damage] = DAMAGES) -> Verdict:
    """Damage a file of a finished dataset: `validate` and `status` report it, no run ends with a traceback, `--check` repairs it."""
    trial.copy()
    kinds: dict[str, list[Path]] = {}
    for path in sorted(path for path in trial.data.rglob("*") if path.is_file() and path.stat().st_size and ".lock" not in path.name):
        if path.name != "lock":
            kinds.setdefault(kind_of(path, trial.data), []).append(path)
    kind = str(trial.rng.choice(sorted(kinds)))
    path = kinds[kind][trial.rng.integers(len(kinds[kind]))]
    name = str(trial.rng.choice(sorted(damages)))
    before = path.read_bytes()
    damages[name](path, trial.rng, [other for other in kinds[kind] if other != path] or [path])
    what = f"{kind} {path.relative_to(trial.data)} {name}"
    looked = trial.run(lambda: _look(trial.data))
    if looked.status != OK:
        return Verdict(what, fault_of_ours=f"validate or status ended: {looked.output.strip()[-600:]}")
    same = path.is_file() and path.read_bytes() == before
    noticed = "not as it should be" in looked.output
    if not noticed and not same and kind != "training log" and not _is_harmless(path, name):
        return Verdict(what, fault_of_ours="silent: validate said that all is well")
    return trial.mended(what, trial.run(lambda: trial.sandbox.make(trial.data)), check=True)


def row_damaged(trial: Trial) -> Verdict:
    """Damage a row before it is published."""
    trial.copy(without="simulate-touch")
    stage = trial.sandbox.only("simulate-touch")

    def stop_before_packing() -> None:
        from pipeline.engine import shard_plan

        shard_plan.ShardPlan._publish = lambda *_: os._exit(OK)
        stage.make(trial.data)

    trial.run(stop_before_packing)
    files = sorted((trial.data / ".work").rglob("*.row"))
    path = files[trial.rng.integers(len(files))]
    name = str(trial.rng.choice(sorted(DAMAGES)))
    DAMAGES[name](path, trial.rng, [other for other in files if other != path])
    first = trial.run(lambda: stage.make(trial.data))
    return trial.mended(f"row of {path.parent.name} {name}", first, stages=("simulate-touch",))


def _is_harmless(path: Path, name: str) -> bool:
    """Return whether a dataset is complete without this file: `dataset.json` follows from the records."""
    return path.name == "dataset.json" and name == "deleted"


def _look(data: Path) -> None:
    """Do the work of `validate` and `status`; print a line for each problem."""
    problems = problems_in(data)
    account = status.read_account(data)
    with contextlib.redirect_stdout(io.StringIO()):
        status.show(account, console_on(io.StringIO()))
        account.to_json()
    for line in [*problems, *account.damaged]:
        print(f"not as it should be: {line}")
