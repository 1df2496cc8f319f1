"""Small stages without physics for the tests of the engine."""

import ctypes
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.settings import ObjectSettings, setting
from pipeline.config.sources import Object
from pipeline.console import console_on
from pipeline.engine.executor import Serial, Work
from pipeline.engine.make import make, plans
from pipeline.engine.plan import Request
from pipeline.engine.stage import Cost, DatasetJob, DatasetStage, Inputs, ObjectStage, Unit
from pipeline.errors import InvalidInput, StageError, StoreError
from pipeline.store.digest import hashes_of
from pipeline.store.directory import Collection, DataDirectory
from pipeline.store.publish import commit_folder
from pipeline.store.record import Failure, FolderRecord
from pipeline.store.rows import Result, Row, conform
from schemas.base import Array, Artifact, coordinates

CONSOLE = console_on(sys.stderr)

NOISE = Artifact(
    name="noise",
    version=1,
    summary="Random numbers.",
    arrays={
        "values": Array("object sample xyz", "float32", "m", "Noise."),
        "label": Array("object", "string", "1", "A word."),
        "reach": Array("sample xyz", "float64", "m", "The scale of the noise."),
        **coordinates("sensor"),
    },
    ragged={"lists/numbers": Array("number", "int32", "1", "As many as the id is long.")},
)
MEAN = Artifact(
    name="mean",
    version=1,
    summary="Their means.",
    arrays={"mean": Array("object xyz", "float64", "m", "The mean of `values`."), **coordinates("sensor")},
)


class NoiseSettings(ObjectSettings):
    samples: int = setting(50, "enough for a mean", gt=0)
    batch: int = setting(8, "fits the cache", changes="speed")


class _TinyStage(ObjectStage):
    settings_type = NoiseSettings

    def cost(self, settings: NoiseSettings) -> Cost:
        return Cost(0.01, 1)


class MakeNoise(_TinyStage):
    name = "make-noise"
    summary = "draw numbers"

    def __init__(self, version: int = 1, asset: str = "", broken: bool = False) -> None:
        self.output = NOISE.model_copy(update={"version": version})
        self.asset = asset
        self.broken = broken

    def assets(self, settings: NoiseSettings) -> list[Path]:
        return [Path(__file__) if self.asset else Path(__file__).with_name("conftest.py")]

    def constants(self, settings: NoiseSettings) -> Row:
        return {"reach": np.ones((settings.samples, 3)), "sensor": np.array([self.asset or "thumb"])}

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        if self.broken:
            raise OSError("no device")

        def process(unit: Unit, inputs: Inputs) -> Row:
            trouble, _, path = str(unit.source.get("trouble")).partition(" ")
            match trouble:
                case "until" if not Path(path).exists():
                    raise InvalidInput("not yet")
                case "bad":
                    raise InvalidInput("it is bad; make it good")
                case "lost":
                    raise StoreError("its sensor cannot be used")
                case "bug":
                    raise ZeroDivisionError("a fault of ours")
                case "memory":
                    raise MemoryError
                case "sleep":
                    Path(path).touch()
                    ctypes.PyDLL(None).sleep(5)  # native code that holds the interpreter lock
                case "hang":
                    ctypes.PyDLL(None).sleep(60)
                case "crash":
                    os.kill(os.getpid(), signal.SIGSEGV)
                case "crash-once" if not Path(path).exists():
                    Path(path).touch()
                    os.kill(os.getpid(), signal.SIGSEGV)
                case "nan":
                    return {"values": np.full((settings.samples, 3), np.nan), "label": np.array("x"), "lists/numbers": np.arange(1)}
            values = unit.rng("make-noise").standard_normal((settings.samples, 3))
            return {"values": values, "label": np.array(unit.category), "lists/numbers": np.arange(len(unit.name)) + 1}

        yield process


class DiesOpening(MakeNoise):
    """Kills its process while a session opens, unless `flag` exists; with `once`, the first process that dies creates it."""

    def __init__(self, flag: Path, once: bool) -> None:
        super().__init__()
        self.flag, self.once = flag, once

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        if not self.flag.exists():
            if self.once:
                self.flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        with super().session(settings, models) as process:
            yield process


class HoldsLock(MakeNoise):
    """Has a semaphore, as some libraries do."""

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        with multiprocessing.get_context("spawn").Lock(), super().session(settings, models) as process:
            yield process


class Notes(MakeNoise):
    """Writes files that describe its process when its session opens and closes."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        opener = threading.get_ident()
        (self.folder / "temporary").write_text(tempfile.mkdtemp())
        (self.folder / "threads").write_text(os.environ["OMP_NUM_THREADS"])
        with super().session(settings, models) as process:
            yield process
        (self.folder / ("closed there" if threading.get_ident() == opener else "closed elsewhere")).touch()


class TakeMean(_TinyStage):
    name = "take-mean"
    summary = "average them"
    output = MEAN

    def inputs(self, settings: NoiseSettings) -> tuple[Artifact, ...]:
        return (NOISE,)

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        yield lambda unit, inputs: {"mean": inputs["noise"]["values"].astype(np.float64).mean(axis=0)}


class Compare(_TinyStage):
    name = "compare"
    summary = "look at numbers and means"
    output = MEAN.model_copy(update={"name": "comparison"})

    def inputs(self, settings: NoiseSettings) -> tuple[Artifact, ...]:
        return (NOISE, MEAN)

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        yield lambda unit, inputs: {"mean": inputs["mean"]["mean"] - inputs["noise"]["values"][0]}


class Halve(_TinyStage):
    """Reads means only, not the noise that they are computed from."""

    name = "halve"
    summary = "halve means"
    output = MEAN.model_copy(update={"name": "halves"})

    def inputs(self, settings: NoiseSettings) -> tuple[Artifact, ...]:
        return (MEAN,)

    @contextmanager
    def session(self, settings: NoiseSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        yield lambda unit, inputs: {"mean": inputs["mean"]["mean"] / 2}


class Average(DatasetStage):
    """Writes the mean over all training objects to a file; `dies` leaves the folder unfinished."""

    name = "average"
    summary = "average them all"
    settings_type = NoiseSettings

    def __init__(self, dies: bool = False, trained: tuple[str, ...] = ()) -> None:
        self.dies, self.trained = dies, trained
        self.made = 0

    def inputs(self, settings: NoiseSettings) -> tuple[Artifact, ...]:
        return (NOISE,)

    def models(self, settings: NoiseSettings) -> tuple[str, ...]:
        return self.trained

    def splits(self, settings: NoiseSettings) -> tuple[str, ...]:
        return ("train",)

    def writes(self, settings: NoiseSettings) -> str:
        return "models/second" if self.trained else "models/average"

    def cost(self, settings: NoiseSettings, objects: int) -> Cost:
        return Cost(0.01, 1)

    def make(self, job: DatasetJob) -> dict[str, Any]:
        self.made += 1
        begun = job.folder / "begun"
        if self.dies:
            begun.write_text("half")
            raise StageError("no more")
        noise = published(job.data)
        means = [float(noise.view(name)["values"].mean()) for name in noise if noise.row(name).split == "train"]
        facts = {"resumed": begun.exists()}
        begun.unlink(missing_ok=True)
        (job.folder / "mean.json").write_text(json.dumps(means))
        return facts


def objects(count: int, kind: str = "letter", split: str = "train", **troubles: str) -> list[Object]:
    """Make objects a, b, c …, some of them with a trouble."""
    names = [chr(ord("a") + number) for number in range(count)]
    return [
        Object(name, kind, {"kind": "procedural", "category": "bottle", "trouble": troubles.get(name), "name": name}, split)
        for name in names
    ]


def request(data: Path, stage: Any = None, count: int = 5, items: list[Object] | None = None, **changes: Any) -> Request:
    """Make a request for a tiny stage, by default to make noise for five objects."""
    values = changes.pop("settings", {})
    items = objects(count) if items is None else items
    named = {"manifest": "tiny", "seed": 0, "preset": "draft"} | changes
    return Request(stage=stage or MakeNoise(), settings=NoiseSettings(**values), objects=items, data=data, **named)


def plan_of(wanted: Request) -> Any:
    """Make the only plan of a request."""
    (plan,) = plans(wanted)
    return plan


def run(wanted: Request, shard: int | None = None) -> int:
    """Run a stage; return the number of objects made, without those that failed."""
    with wanted.executor:
        return sum(made.objects for made in make(wanted, CONSOLE, shard))


def work_of(wanted: Request) -> tuple[Work, list[Unit]]:
    """Return what an executor is given of the only plan of a request."""
    plan = plan_of(wanted)
    return Work(plan.stage, plan.settings, wanted.data, plan.model_digests, plan.assets), plan.units


def leave_row(wanted: Request, name: str) -> None:
    """Finish the row of one object without publishing it, as a killed run does."""
    work, units = work_of(wanted)
    list(Serial().run(work, [unit for unit in units if unit.name == name]))


def pack(wanted: Request, row: Callable[[Unit], Row], failed: str = "") -> None:
    """Publish the rows that a function gives for each object, without starting workers; `failed` names failed objects."""
    for plan in plans(wanted):
        for unit in plan.units:
            failure = Failure(stage=plan.stage.name, reason="no room") if unit.name in failed else None
            values = {} if failure else conform(plan.artifact, row(unit))
            plan.rows.save(Result(name=unit.name, key=unit.key, failure=failure), values, unit.category)
        assert not plan.make(CONSOLE).objects


def publish(data: Path, name: str, folder: Path, stage: str, facts: dict[str, Any] | None = None) -> Path:
    """Publish a folder as a dataset stage does; return its published path."""
    record = FolderRecord(
        **{"location": "unpublished", "stage": stage, "key": "0" * 64, "settings": {}, "speed_settings": {}, "preset": "draft"},
        **{"seed": 0, "manifest": "tiny", "models": {}, "versions": {}, "processor": {}, "splits": (), "inputs": {}},
        **{"facts": facts or {}, "seconds": 1.5, "files": hashes_of(folder)},
    )
    commit_folder(DataDirectory(data), name, folder, record)
    return DataDirectory(data).folder_path(name)


def published(data: Path, artifact: Artifact = NOISE) -> Collection:
    """Open an artifact as readers see it."""
    return DataDirectory(data).collection(artifact)


def digest(data: Path, artifact: Artifact = NOISE) -> str:
    """Compute the digest of an artifact as readers see it."""
    return published(data, artifact).digest()
