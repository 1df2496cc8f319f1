"""Measure the time and the error of settings on a sample of the user's objects, on this machine."""

import os
import shlex
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from pipeline.config.settings import Settings, load_presets
from pipeline.config.sources import Object
from pipeline.engine import keys
from pipeline.engine.make import make
from pipeline.engine.plan import Request
from pipeline.engine.stage import Changes
from pipeline.errors import InvalidInput, PipelineError, StoreError
from pipeline.formats.file_content import regular_stat
from pipeline.rng import numpy_rng
from pipeline.store import digest
from pipeline.store.record import processor
from pipeline.tradeoff.sweep import file_name
from pipeline.tradeoff.trades import FOLDER, MeasuredTrade, Point, files_of, kilobytes, read_trade, times_of
from stages.registry import DATASET, GRASP_STAGES, TRADED, assignment, load_stage, load_trade, resolve

TOUCH_ALONE = ("train-gcn.configuration=touch", "evaluate.configurations=[touch]")  # whose trade is measured: it needs no images
LONGEST = 0.25  # share of the given time that one candidate may take; the paper's trainings take days
FEWEST, MOST = 4, 32  # number of objects in a sample: fewer do not show the spread, more add little information


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

    def settings(self, stage: str, changes: Changes | None = None, preset: str | None = None) -> Settings:
        """Resolve a stage's settings, with changes to the user's."""
        changed = (f"{stage}.{assignment(name, value)}" for name, value in (changes or {}).items())
        return resolve(stage, preset or self.preset, [*self.assignments, *self.network, *changed])

    def make(self, stage: str, settings: Settings, data: Path, console: Console) -> None:
        """Make a stage's output in a data directory, one object after the other in this process."""
        make(Request(load_stage(stage), settings, self.manifest, self.objects, self.preset, self.seed, data), console)

    def seconds(self, stage: str, settings: Settings | None = None) -> float:
        """Foresee the seconds that a stage takes for the sample on one core; by default with the user's settings."""
        return load_stage(stage).cost_of(settings or self.settings(stage), self.objects)[1].seconds

    @property
    def sample(self) -> str:
        """Hash the objects' categories, splits and sources."""
        return digest.of_json([[item.object_id, item.category, item.split, keys.source_key(item.source)] for item in self.objects])

    def affordable(self, seconds: float, cost: Callable[["Setup"], float]) -> "Setup":
        """Keep the largest sample, of `FEWEST` to `MOST` objects, that costs at most these seconds; `FEWEST` if all cost more."""
        for count in range(MOST, FEWEST - 1, -1):
            sample = replace(self, objects=stratified(self.objects, count, self.seed))
            if cost(sample) <= seconds:
                break
        return sample


def stratified(objects: Sequence[Object], count: int, seed: int) -> list[Object]:
    """Choose `count` objects, at least one of each split, evenly over splits, categories and sizes of mesh files.

    They are a share of each split, in the manifest's order; all objects if there are no more.
    """
    if len(objects) <= count:
        return list(objects)
    sizes = {item.object_id: regular_stat(item.source["file"]).st_size if "file" in item.source else 0 for item in objects}
    selected: set[str] = set()
    for split in sorted({item.split for item in objects}):
        rng = numpy_rng(seed, "tradeoff-sample", split)
        members = [item for item in objects if item.split == split]
        members.sort(key=lambda item: (item.category, sizes[item.object_id], item.object_id))
        share = max(1, round(count * len(members) / len(objects)))
        ends = np.linspace(0, len(members), share + 1).astype(int)  # one out of each of as many equal parts
        selected |= {members[int(rng.integers(start, stop))].object_id for start, stop in pairwise(ends)}
    return [item for item in objects if item.object_id in selected]


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


def trade_key(stages: Sequence[str], setup: Setup, *further: str) -> str:
    """Hash what the figures of stages, in the order of the pipeline, depend on, apart from the machine and the sample.

    That is code, settings and the content of description files.
    """
    attributes: dict[str, Any] = {}
    parts: dict[str, Any] = {}
    for name in stages:
        loaded: Any = load_stage(name)
        settings = setup.settings(name)
        if loaded.per_object:
            settings = loaded.resolve_settings(settings, attributes)
            attributes[loaded.output.name] = {**loaded.attributes(settings), "settings": settings.results()}
        parts[name] = [keys.code_hash(loaded), settings.results(), keys.assets_digest(loaded.assets(settings))]
    return digest.of_json([parts, setup.seed, *further])


def stage_key(stage: str, setup: Setup) -> str:
    """Hash what the trade of a stage depends on, as `trade_key`."""
    return trade_key([*stages_before(stage, setup), stage], setup)


def candidates(
    stage: str,
    setup: Setup,
) -> dict[str, tuple[Settings, Point]]:  # by label: settings, and their point without figures
    """List the settings to measure: the user's, those of other presets, and those that the stage declares."""
    user_settings, presets = setup.settings(stage), {name: setup.settings(stage, preset=name) for name in load_presets()}
    listed = [user_settings, *presets.values()]
    for changes in load_trade(stage).candidates:
        with suppress(PipelineError):  # one that does not fit the user's other settings: more grasps than its attempts yield
            listed.append(setup.settings(stage, changes))
    points: dict[str, tuple[Settings, Point]] = {}
    for settings in listed:
        if any(settings.results() == earlier.results() for earlier, _ in points.values()):
            continue
        named = tuple(name for name, preset in presets.items() if preset.results() == settings.results())
        mine = user_settings.results()
        changes = {name: value for name, value in settings.results().items() if mine[name] != value}
        label = ", ".join(named or (f"{name}={value}" for name, value in changes.items())) or "your settings"
        points[label] = settings, Point(label=label, changes=changes, presets=named, times={}, kilobytes=0, errors={})
    return points


def forecast(stage: str, setup: Setup, limit: float) -> tuple[float, list[str]]:
    """Predict the seconds of a stage's candidates; list those that are skipped as they exceed a limit even on few objects."""
    trade, total, skipped = load_trade(stage), 0.0, []
    after = setup.seconds(trade.evaluated_by) if trade.evaluated_by else 0.0
    for label, (settings, _) in candidates(stage, setup).items():
        seconds = setup.seconds(stage, settings)
        if seconds * FEWEST / len(setup.objects) > limit:
            skipped.append(label)
        else:
            total += seconds + after
    if trade.reference is not None:
        total += setup.seconds(stage, setup.settings(stage, trade.reference))
    return total, skipped


def foreseen(stages: Sequence[str], setup: Setup, limit: float) -> float:
    """Predict the seconds of the candidates of all stages, as `forecast`, and of the stages before them once."""
    before = {name for stage in stages for name in stages_before(stage, setup)}
    return sum(map(setup.seconds, before)) + sum(forecast(stage, setup, limit)[0] for stage in stages)


def current_trades(setup: Setup) -> list[MeasuredTrade]:
    """Read the trades that were measured with these settings and this code; each stage that makes a dataset must have one."""
    trades = []
    for stage in TRADED:
        trade = read_trade(setup.data, stage)
        if trade is not None and trade.points and trade.key == stage_key(stage, setup):
            trades.append(trade)
        elif trade is not None or stage in DATASET:
            how = "not measured yet" if trade is None else "measured with other settings or other code"
            changed = "".join(f" --set {shlex.quote(line)}" for line in setup.assignments)
            command = f"vt-pipeline tradeoff {stage} --data {shlex.quote(str(setup.data))} --preset {setup.preset}{changed}"
            remedy = f"name the --data of `vt-pipeline tradeoff`, or run `{command}`, with your manifest and objects"
            raise InvalidInput(f"{stage}: {how}; {remedy}")
    return trades


def measure_points(
    setup: Setup,
    name: str,  # of the trade
    key: str,  # what its figures depend on
    labels: Sequence[str],  # of the points
    measure: Callable[[str, Path], tuple[Point, dict[str, Any]]],  # a point, in a folder; it, and fields of the trade that it shows
    deadline: float,  # of `time.monotonic()`; after it only the first point is begun
    **facts: Any,  # further fields of the trade
) -> MeasuredTrade:
    """Measure points, or read those measured under the same key with these objects; a killed measurement continues.

    The trade is also written below the data directory; it lacks the points that the deadline left no time for.
    """
    machine, sample, folder = str(processor()["model"]), setup.sample, setup.data / FOLDER / name
    measured = read_trade(setup.data, name)
    if measured is not None and (measured.key, measured.sample, measured.machine) == (key, sample, machine):
        measured = measured.model_copy(update={"total": len(labels)})  # the time limit changes this, too
    else:
        shutil.rmtree(folder, ignore_errors=True)
        user: dict[str, Any] = {
            "preset": setup.preset,
            "assignments": setup.assignments,
            "objects": tuple(item.object_id for item in setup.objects),
        }
        measured = MeasuredTrade(stage=name, key=key, sample=sample, machine=machine, total=len(labels), **user, **facts)
    measured_labels = {point.label for point in measured.points}
    missing = [label for label in labels if label not in measured_labels]
    for label in missing:
        if label != missing[0] and time.monotonic() > deadline:
            break
        point, shown = measure(label, folder)
        measured = measured.model_copy(update={"points": (*measured.points, point), **shown})
        measured.write(setup.data)
    if missing:
        shutil.rmtree(folder, ignore_errors=True)
    return measured


def measure_trade(
    stage: str,  # one of `TRADED`
    setup: Setup,
    *,
    limit: float,  # s on one core; candidates expected to take longer with `FEWEST` objects are skipped
    deadline: float,  # as `measure_points` takes it
    console: Console,
) -> MeasuredTrade:
    """Measure a stage's trade, as `measure_points`."""
    trade, loaded = load_trade(stage), load_stage(stage)
    skipped = forecast(stage, setup, limit)[1]
    listed = {label: entry for label, entry in candidates(stage, setup).items() if label not in skipped}
    if not listed:
        raise InvalidInput(f"{stage}: every candidate takes longer than there is time for, even on few objects; give more --minutes")
    trained = sum(item.split == "train" for item in setup.objects) * (not loaded.per_object)
    outputs = [load_stage(name).writes(setup.settings(name)) for name in stages_before(stage, setup)]

    @cache
    def inputs() -> Path:
        """Make the inputs, when the first point needs them."""
        made = setup.data / FOLDER / f"inputs-{setup.sample[:16]}"
        for other in set(made.parent.glob("inputs-*")) - {made}:  # of another sample
            shutil.rmtree(other)
        for name in stages_before(stage, setup):
            setup.make(name, setup.settings(name), made, console)
        return made

    @cache
    def reference(folder: Path) -> Path | None:
        if trade.reference is None:
            return None
        made = linked_copy(inputs(), outputs, folder / "reference")
        setup.make(stage, setup.settings(stage, trade.reference), made, console)
        return made

    def measure(label: str, folder: Path) -> tuple[Point, dict[str, Any]]:
        compared, (settings, point) = reference(folder), listed[label]
        data = linked_copy(inputs(), outputs, folder / file_name(label))
        setup.make(stage, settings, data, console)
        if trade.evaluated_by:
            setup.make(trade.evaluated_by, setup.settings(trade.evaluated_by), data, Console(quiet=True))
        errors = {name: (error,) for name, error in trade.errors(data, compared or data).items()}
        if not errors:
            remedy = f"see `vt-pipeline status {shlex.quote(str(data))}`"
            raise StoreError(f"{stage}, {label}: no object of the sample has this error ({trade.metric}); {remedy}")
        times, size = times_of(loaded, settings, data, trained), kilobytes(data, loaded.writes(settings))
        shown = {"trials": trade.trials(data)} if trade.trials else {}
        shutil.rmtree(data)
        size /= 1 if trained else len(setup.objects)
        return point.model_copy(update={"times": times, "kilobytes": size, "errors": errors}), shown

    facts = {"metric": trade.metric, "unit": trade.unit, "trained": trained}
    return measure_points(setup, stage, stage_key(stage, setup), list(listed), measure, deadline, **facts)


def linked_copy(inputs: Path, outputs: Sequence[str], data: Path) -> Path:
    """Make a data directory whose inputs are hard links to the same files, which are never written to."""
    data.mkdir(parents=True, exist_ok=True)
    for name in ("dataset.json", *outputs):
        for path in files_of(inputs / name if (inputs / name).exists() else (inputs / name).parent):
            copy = data / path.relative_to(inputs)
            copy.parent.mkdir(parents=True, exist_ok=True)
            if not copy.exists():
                os.link(path, copy)
    return data
