"""Measure the time and the error of settings on a sample of the user's objects, on this machine."""

import os
import shlex
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from pipeline.config.settings import Settings, load_presets
from pipeline.config.sources import Object
from pipeline.engine import keys
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.engine.stage import Changes, Trade
from pipeline.errors import InvalidInput, PipelineError, StoreError, unknown_name
from pipeline.store import digest
from pipeline.store.directory import DataDirectory
from pipeline.store.record import processor
from pipeline.tradeoff.measured import FOLDER, MeasuredTrade, Point, read_trade
from pipeline.tradeoff.sample import FEWEST
from pipeline.tradeoff.sweep import assignment, file_name
from schemas.catalogue import ARTIFACTS
from stages.registry import GRASP_STAGES, TRADED, load_stage, load_trade, resolve

TOUCH_ALONE = ("train-gcn.configuration=touch", "evaluate.configurations=[touch]")
"""The network whose trade is measured: it needs no images."""
LONGEST = 0.25
"""Share of the given time that one candidate may take; the paper's trainings take days."""


@dataclass(frozen=True)
class Setup:
    """The sample that is measured on, and the user's settings."""

    data: Path  # everything is made below its folder `tradeoff`
    manifest: str  # its name
    objects: Sequence[Object]  # the sample
    seed: int  # root seed
    preset: str  # with `assignments`: the user's settings
    assignments: tuple[str, ...] = ()
    network: tuple[str, ...] = TOUCH_ALONE  # further assignments: which network is trained and evaluated

    def with_objects(self, objects: Sequence[Object]) -> "Setup":
        """Return the same with other objects."""
        return replace(self, objects=objects)

    def settings(self, stage: str, changes: Changes | None = None, preset: str | None = None) -> Settings:
        """Resolve a stage's settings, with changes to the user's."""
        changed = (f"{stage}.{assignment(name, value)}" for name, value in (changes or {}).items())
        return resolve(stage, preset or self.preset, [*self.assignments, *self.network, *changed])

    def make(self, stage: str, settings: Settings, data: Path, console: Console) -> None:
        """Make a stage's output in a data directory, one object after the other in this process."""
        request = Request(load_stage(stage), settings, self.manifest, self.objects, self.preset, self.seed, data)
        make(request, console)

    def begin(self, folder: Path, stage: str, key: str, **facts: Any) -> MeasuredTrade:
        """Read the measurement under this key with these objects, else begin a new one and clear its folder."""
        machine = str(processor()["model"])
        sample = digest.of_json([[item.object_id, item.category, item.split, keys.source_key(item.source)] for item in self.objects])
        measured = read_trade(self.data, stage)
        if measured is not None and (measured.key, measured.sample, measured.machine) == (key, sample, machine):
            return measured.model_copy(update={"total": facts["total"]})  # the time limit changes this, too
        shutil.rmtree(folder, ignore_errors=True)
        user: dict[str, Any] = {"preset": self.preset, "assignments": self.assignments, "machine": machine, "sample": sample}
        return MeasuredTrade(stage=stage, key=key, objects=tuple(item.object_id for item in self.objects), **user, **facts)

    def seconds(self, stage: str, settings: Settings) -> float:
        """Foresee the seconds that a stage takes for the sample on one core."""
        return load_stage(stage).cost_of(settings, self.objects)[1].seconds


def stages_before(stage: str, setup: Setup) -> list[str]:
    """List the stages whose outputs a stage needs, directly or indirectly, in the order of the pipeline."""
    makers = {load_stage(name).writes(setup.settings(name)): name for name in GRASP_STAGES}
    needed: set[str] = set()
    waiting = [stage]
    while waiting:
        loaded, settings = load_stage(name := waiting.pop()), setup.settings(name)
        direct = {makers[output] for output in loaded.reads(settings)} - needed
        needed |= direct
        waiting += direct
    return [name for name in makers.values() if name in needed]


def trade_key(stage: str, setup: Setup) -> str:
    """Hash what a stage's figures depend on, apart from the machine and the sample: code, settings and description files."""
    return digest.of_json({**dependencies((*stages_before(stage, setup), stage), setup), "seed": setup.seed})


def dependencies(stages: Sequence[str], setup: Setup) -> dict[str, Any]:
    """Collect what stages, in the order of the pipeline, depend on: code, settings and the content of description files."""
    attributes: dict[str, Any] = {}
    parts: dict[str, Any] = {}
    for name in stages:
        loaded: Any = load_stage(name)
        settings = setup.settings(name)
        if loaded.per_object:
            settings = loaded.resolve_settings(settings, attributes)
            attributes[loaded.output.name] = {**loaded.attributes(settings), "settings": settings.results()}
        parts[name] = [keys.code_hash(loaded), settings.results(), keys.assets_digest(loaded.assets(settings))]
    return parts


def _declared(stage: str) -> Trade:
    if stage not in TRADED:
        raise InvalidInput(unknown_name("stage", stage, TRADED))
    return load_trade(stage)


def candidates(
    stage: str,
    setup: Setup,
) -> dict[str, tuple[Settings, Point]]:  # by label: settings, and their point without figures
    """List the settings to measure: the user's, those of other presets, and those that the stage declares."""
    user_settings, presets = setup.settings(stage), {name: setup.settings(stage, preset=name) for name in load_presets()}
    listed = [user_settings, *presets.values()]
    for changes in _declared(stage).candidates:
        with suppress(PipelineError):  # one that does not fit the user's other settings: more grasps than its attempts yield
            listed.append(setup.settings(stage, changes))
    points: dict[str, tuple[Settings, Point]] = {}
    for settings in listed:
        if any(settings.results() == earlier.results() for earlier, _ in points.values()):
            continue
        named = tuple(name for name, preset in presets.items() if preset.results() == settings.results())
        mine, theirs = user_settings.results(), settings.results()
        changes = {name: value for name, value in theirs.items() if mine[name] != value}
        label = ", ".join(named or (f"{name}={value}" for name, value in changes.items())) or "your settings"
        points[label] = settings, Point(label=label, changes=changes, presets=named, times={}, kilobytes=0, errors={})
    return points


def forecast(stage: str, setup: Setup, limit: float) -> tuple[float, list[str]]:
    """Predict the seconds of a stage's candidates; list those that are skipped as they exceed a limit even on few objects."""
    trade, total, left_out = _declared(stage), 0.0, []
    after = setup.seconds(trade.evaluated_by, setup.settings(trade.evaluated_by)) if trade.evaluated_by else 0.0
    for label, (settings, _) in candidates(stage, setup).items():
        seconds = setup.seconds(stage, settings)
        if seconds * FEWEST / len(setup.objects) > limit:
            left_out.append(label)
        else:
            total += seconds + after
    if trade.reference is not None:
        total += setup.seconds(stage, setup.settings(stage, trade.reference))
    return total, left_out


def measure_trade(
    stage: str,  # one of `TRADED`
    setup: Setup,
    *,
    limit: float,  # s on one core; candidates expected to take longer with `FEWEST` objects are skipped
    deadline: float,  # of `time.monotonic()`; after it only the first candidate is begun
    console: Console,
) -> MeasuredTrade:
    """Measure a stage's trade, or read it if it is measured under the same key; a killed measurement continues.

    The trade is also written below the data directory; it lacks the candidates that the deadline left no time for.
    Raise an `InvalidInput` if the stage declares no trade; a `StoreError` if no object of the sample came through the
    stages, or none has what the error is measured on.
    """
    trade, loaded = _declared(stage), load_stage(stage)
    folder = setup.data / FOLDER / stage
    left_out = forecast(stage, setup, limit)[1]
    listed = {label: entry for label, entry in candidates(stage, setup).items() if label not in left_out}
    if not listed:
        raise InvalidInput(f"{stage}: every candidate takes longer than there is time for, even on few objects; give more --minutes")
    trained = sum(item.split == "train" for item in setup.objects) * (not loaded.per_object)
    facts = {"metric": trade.metric, "unit": trade.unit, "trained": trained, "total": len(listed)}
    measured = setup.begin(folder, stage, trade_key(stage, setup), **facts)
    measured_labels = {point.label for point in measured.points}
    missing = {label: entry for label, entry in listed.items() if label not in measured_labels}
    if not missing:
        return measured
    inputs = setup.data / FOLDER / f"inputs-{measured.sample[:16]}"
    for other in set(inputs.parent.glob("inputs-*")) - {inputs}:  # of another sample
        shutil.rmtree(other)
    for name in (before := stages_before(stage, setup)):
        setup.make(name, setup.settings(name), inputs, console)
    outputs = [load_stage(name).writes(setup.settings(name)) for name in before]
    reference = None
    if trade.reference is not None:
        reference = linked_copy(inputs, outputs, folder / "reference")
        setup.make(stage, setup.settings(stage, trade.reference), reference, console)
    for label, (settings, point) in missing.items():
        if len(measured.points) > len(measured_labels) and time.monotonic() > deadline:
            break
        data = linked_copy(inputs, outputs, folder / file_name(label))
        setup.make(stage, settings, data, console)
        if trade.evaluated_by:
            setup.make(trade.evaluated_by, setup.settings(trade.evaluated_by), data, Console(quiet=True))
        times = times_of(loaded, settings, data, trained)
        size = kilobytes(data, loaded.writes(settings)) / (1 if trained else len(setup.objects))
        errors = {name: (error,) for name, error in trade.errors(data, reference or data).items()}
        if not errors:
            remedy = f"see `vt-pipeline status {shlex.quote(str(data))}`"
            raise StoreError(f"{stage}, {label}: no object of the sample has this error ({trade.metric}); {remedy}")
        if trade.trials:
            measured = measured.model_copy(update={"trials": trade.trials(data)})
        measured = measured.with_point(point.model_copy(update={"times": times, "kilobytes": size, "errors": errors}))
        measured.write(setup.data)
        shutil.rmtree(data)
    shutil.rmtree(folder, ignore_errors=True)
    return measured


def linked_copy(inputs: Path, outputs: Sequence[str], data: Path) -> Path:
    """Make a data directory whose inputs are hard links to the same files, which are never written to."""
    data.mkdir(parents=True, exist_ok=True)
    for name in ("dataset.json", *outputs):
        for path in _files(inputs / name if (inputs / name).exists() else (inputs / name).parent):
            copy = data / path.relative_to(inputs)
            copy.parent.mkdir(parents=True, exist_ok=True)
            if not copy.exists():
                os.link(path, copy)
    return data


def _files(path: Path) -> Iterator[Path]:
    return iter([path]) if path.is_file() else (inner for inner in path.rglob("*") if inner.is_file() and not inner.is_symlink())


def kilobytes(data: Path, output: str) -> float:
    """Measure the size of an artifact or a folder of a data directory, without replaced data."""
    directory = DataDirectory(data)
    shards = directory.collection(ARTIFACTS[output]).shards if output in ARTIFACTS else []
    paths = [Path(str(shard.path)) for shard in shards] or [directory.verified_folder(output)]
    return sum(inner.stat().st_size for path in paths for inner in _files(path)) / 1e3


def times_of(stage: Any, settings: Settings, data: Path, trained: int) -> dict[str, float]:
    """Read the seconds per object from records, of a training its share per object; the first object, a warm-up, counts only if alone."""
    directory, output = DataDirectory(data), stage.writes(settings)
    if trained:
        return {"each": float(directory.folder(output).facts["training_seconds"]) / trained}
    rows = [row for shard in directory.collection(ARTIFACTS[output]).shards for row in shard.record.rows if row.failure is None]
    return {row.object_id: row.seconds for row in rows[1:] or rows}
