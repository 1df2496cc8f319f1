"""Symbolic links, pipes and devices in a dataset, and open readers of groups that are replaced and collected."""

import os
import stat
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from checks.faults.damage import damaged
from checks.faults.trial import Trial, Verdict
from checks.forked import IN_WORDS, OK
from pipeline.cli import app
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.object_rows import ObjectRows
from pipeline.store.directory import DataDirectory
from pipeline.store.garbage import collect_everything
from schemas.catalogue import artifact_of

REPLACED = {
    "sample-surfaces": ("sample-surfaces.points=400", "points"),
    "render-vision": ("render-vision.resolution=32", "occluded"),
    "fit-charts": ("fit-charts.max_iterations=10", "vertices"),
}
"""Stages that are run again with another setting, and an array of each."""

REPORT = ("report", "report/objects", "report/figures", "report/index.html", "report/style.css", "report/pages.json")
"""Folders and files of a report that may be links."""

"""Unit of the additional memory that a process may take, so that reading a device to its end is noticed."""

AGAIN = "open the dataset again"

MINE = f"mine.{'0' * 32}.tmp"
"""A file of another user with the name of an unfinished one."""


GARBAGE = ("0001-of-0001-0123456789abcdef.zarr", "evaluation-0123456789abcdef")
"""Folders of another user with names that a run gives in an artifact's folder, and in the others."""


def _bystanders(folder: Path) -> dict[Path, bytes]:
    """Put files of another user with names like garbage into a folder; return their contents."""
    files = {folder / MINE: b"of value"} | {folder / name / "one.png": b"of value, too" for name in GARBAGE}
    for path, content in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return files


def _harmed(files: dict[Path, bytes]) -> list[str]:
    return [str(path) for path, content in files.items() if not path.is_file() or path.read_bytes() != content]


def linked(trial: Trial) -> Verdict:
    """Move a folder or file of a dataset elsewhere and link to it; then run the stages and collect garbage of any age."""
    trial.copy()
    kinds: dict[str, list[Path]] = {
        "folder of an artifact": [path for path in trial.data.iterdir() if (path / "0000-of-0001.json").exists()],
        "folder of models": [trial.data / "models"],
        "group": sorted(trial.data.glob("*/*.zarr")),
        "folder of a model": [path for path in sorted(trial.data.glob("models/*-*")) if path.is_dir()],
        "record": sorted(trial.data.glob("*/0000-of-0001.json")),
        "chunk": sorted(path for path in trial.data.glob("*/*.zarr/*/c/**/*") if path.is_file()),
    }
    kind = str(trial.rng.choice(sorted(kinds)))
    path = kinds[kind][trial.rng.integers(len(kinds[kind]))]
    elsewhere = trial.folder / "elsewhere" / path.name
    elsewhere.parent.mkdir()
    path.rename(elsewhere)
    path.symlink_to(elsewhere)
    others = _bystanders(elsewhere if elsewhere.is_dir() and not kind.startswith(("group", "folder of a model")) else elsewhere.parent)

    def work() -> None:
        trial.sandbox.make(trial.data, check=True)
        collect_everything(DataDirectory(trial.data), older_than=-1)

    end, what = trial.run(work), f"{kind} {path.relative_to(trial.data)}"
    if lost := _harmed(others):
        return Verdict(what, fault_of_ours=f"lost: {', '.join(lost)}")
    for file in others:  # `validate` would report that they have no record
        file.unlink()
        if file.parent.name in GARBAGE:
            file.parent.rmdir()
    return trial.mended(what, end)


def report_linked(trial: Trial) -> Verdict:
    """Put a link to files of another user into a report: `report` ends with an error and does not touch them."""
    trial.copy()
    elsewhere = trial.folder / "elsewhere"
    others = _bystanders(elsewhere)
    place = str(trial.rng.choice(REPORT))
    path = trial.data / place
    path.parent.mkdir(exist_ok=True)
    path.symlink_to(elsewhere if "." not in path.name else elsewhere / MINE)
    end = trial.run(lambda: app(["report", str(trial.data)]))
    if end.status != IN_WORDS or "Traceback" in end.output:
        return Verdict(place, fault_of_ours=f"not refused: status {end.status}: {end.output.strip()[-600:]}")
    if lost := _harmed(others):
        return Verdict(place, fault_of_ours=f"lost: {', '.join(lost)}")
    if more := [str(path) for path in elsewhere.rglob("*") if path.is_file() and path not in others]:
        return Verdict(place, fault_of_ours=f"written elsewhere: {', '.join(more[:3])}")
    return trial.mended(place, end)


def _socket(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.unlink()
    os.mknod(path, stat.S_IFSOCK | 0o600)


def _device(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.unlink()
    path.symlink_to("/dev/null")


def _link_to_itself(path: Path, rng: np.random.Generator, others: list[Path]) -> None:
    path.unlink()
    path.symlink_to(path.name)


IRREGULAR = {"a socket in its place": _socket, "a link to a device in its place": _device, "a link to itself in its place": _link_to_itself}


def irregular(trial: Trial) -> Verdict:
    """Put a socket, a device or a link to itself in place of a file: it is handled as damage."""
    return damaged(trial, IRREGULAR)


def open_while_made_again(trial: Trial) -> Verdict:
    """Run a stage with another setting and collect the replaced groups while a reader is open."""
    trial.copy()
    stage = str(trial.rng.choice(sorted(REPLACED)))
    setting, array = REPLACED[stage]
    sandbox = replace(trial.sandbox.only(stage), settings=(*trial.sandbox.settings, setting))
    return _replaced_under_a_reader(trial, array, f"made with {setting}", lambda: sandbox.make(trial.data))


def _replaced_under_a_reader(trial: Trial, array: str, how: str, change: Callable[[], object]) -> Verdict:
    """Read one value, replace and collect, read the rest: values are unchanged, or an error says to open the dataset again."""
    kind = str(trial.rng.choice(sorted(READERS)))

    def work() -> None:
        expected = dict(READERS[kind](trial.whole, array))
        reader = READERS[kind](trial.data, array)
        name, value = next(reader)
        assert np.array_equal(value, expected[name]), f"{name} is wrong before anything was replaced"
        change()
        collect_everything(DataDirectory(trial.data), older_than=-1)
        for name, value in reader:
            assert np.array_equal(value, expected[name]), f"{name} is wrong"

    end, what = trial.run(work), f"{array} read as {kind}, {how}"
    if end.status == IN_WORDS and AGAIN not in " ".join(end.output.split()):
        return Verdict(what, fault_of_ours=f"words that do not help: {end.output.strip()[-600:]}")
    if end.status not in (OK, IN_WORDS):
        return Verdict(what, fault_of_ours=f"status {end.status}: {end.output.strip()[-600:]}")
    return trial.mended(what, end)


Values = Iterator[tuple[object, np.ndarray]]


def _rows(data: Path, array: str) -> Values:
    rows = ObjectRows(data, [array], None, cache_megabytes=0)
    yield from ((name, rows.read(array, name)) for name in rows.object_ids)


def _grasps(data: Path, array: str) -> Values:
    grasps = GraspDataset(data, [array], None)
    yield from ((number, np.asarray(grasps[number][array])) for number in range(len(grasps)))


def _views(data: Path, array: str) -> Values:
    collection = DataDirectory(data).collection(artifact_of(array))
    yield from (((name, part), collection.view(name)[part]) for name in collection for part in collection.view(name))


def _labelled(data: Path, array: str) -> Values:
    opened = open_artifact(data, artifact_of(array).name)[array]
    yield from ((str(name), opened.sel(object=name).values) for name in opened.object.values)


READERS = {"rows": _rows, "a PyTorch dataset": _grasps, "views": _views, "an xarray dataset": _labelled}
