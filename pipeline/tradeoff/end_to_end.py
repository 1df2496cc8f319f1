"""What a dataset is made of, against the reconstructions that networks learn from it."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import yaml
from rich.console import Console

from pipeline.engine import keys
from pipeline.engine.stage import DatasetStage
from pipeline.engine.versions import processor
from pipeline.formats.sensor_file import load_sensor
from pipeline.store import digest
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff.measure import Setup, kilobytes, linked_copy, stages_before, times_of
from pipeline.tradeoff.measured import END_TO_END, FOLDER, MeasuredTrade, Point, read_trade
from pipeline.tradeoff.sample import affordable
from pipeline.tradeoff.sweep import file_name
from stages.evaluate.evaluation_files import chamfer_by_object, evaluation_name
from stages.registry import load_stage

NETWORK = ("train-gcn.configuration=occluded-touch", "evaluate.configurations=[occluded-touch]", "evaluate.grasps=[1, 2]")
"""A network that sees and feels; one and two grasps are given, which every variant has."""
TRAININGS = 3
"""Of each network, with other chance."""


@dataclass(frozen=True)
class Variant:
    """A dataset that differs in one thing.

    Attributes
    ----------
    assignments
        Settings that differ from the user's.
    share
        Share of the training objects that it has.
    epochs
        Factor of the epochs of all trainings.
    coarse
        Factor of the sensor's rows and columns.
    """

    assignments: tuple[str, ...] = ()
    share: float = 1.0
    epochs: float = 1.0
    coarse: float = 1.0


VARIANTS: Mapping[str, Variant] = {
    "your settings": Variant(),
    "half the objects": Variant(share=0.5),
    "two grasps per object": Variant(("simulate-grasps.grasps=2",)),
    "images of 192 pixels": Variant(("render-vision.resolution=192",)),
    "touch of half the pixels a side": Variant(coarse=0.5),
    "depth in steps of 61 um": Variant(("simulate-touch.gel_bits=14", "simulate-touch.far_bits=14")),
    "half the epochs": Variant(epochs=0.5),
    "twice the epochs": Variant(epochs=2.0),
}


def measure_end_to_end(setup: Setup, seconds: float, console: Console) -> MeasuredTrade:
    """Measure every variant, or read it where it is measured under the same key; a killed measurement continues.

    Parameters
    ----------
    setup
        All objects, and the user's settings.
    seconds
        For all of it; the sample is as large as this allows.
    console
        Shows progress.

    Returns
    -------
    The trade, also written below the data directory. Times and sizes are those of all objects and trainings together.
    """
    setup = replace(setup, network=NETWORK)
    setup = setup.with_objects(affordable(setup.objects, setup.seed, seconds, lambda sample: _foreseen(setup.with_objects(sample))))
    console.print(f"{len(VARIANTS)} datasets of {len(setup.objects)} objects: about {_foreseen(setup) / 60:.0f} min, less what is measured")
    names = tuple(item.object_id for item in setup.objects)
    chain = [*stages_before("evaluate", setup), "evaluate"]
    settings = {name: setup.settings(name) for name in chain}
    parts = [[name, keys.code_hash(load_stage(name)), own.results()] for name, own in settings.items()]
    key = digest.of_json([parts, setup.seed, keys.sources_hash(__name__)])
    measured = read_trade(setup.data, END_TO_END)
    if measured is None or (measured.key, measured.objects) != (key, names):
        shutil.rmtree(setup.data / FOLDER / END_TO_END, ignore_errors=True)
        measured = MeasuredTrade(
            stage=END_TO_END,
            metric=f"Chamfer distance x 9000 of test objects, {TRAININGS} trainings",
            unit="",
            cost="core seconds in all",
            key=key,
            preset=setup.preset,
            assignments=setup.assignments,
            objects=names,
            trained=sum(item.split == "train" for item in setup.objects),
            machine=str(processor()["model"]),
            total=len(VARIANTS),
        )
    known = {point.label for point in measured.points}
    first = setup.data / FOLDER / END_TO_END / file_name("your settings")
    for label, variant in VARIANTS.items():
        if label in known:
            continue
        data = setup.data / FOLDER / END_TO_END / file_name(label)
        if data != first:
            linked_copy(
                first,
                [load_stage(name).writes(settings[name]) for name in chain[:-1] if not isinstance(load_stage(name), DatasetStage)],
                data,
            )
        point = _measure(label, _changed(setup, variant, data), chain, data, console)
        measured = measured.model_copy(update={"points": (*measured.points, point)})
        measured.write(setup.data)
        if data != first:
            shutil.rmtree(data)
    shutil.rmtree(setup.data / FOLDER / END_TO_END, ignore_errors=True)
    return measured


def _changed(setup: Setup, variant: Variant, data: Path) -> Setup:
    """Apply a variant to a setup."""
    learned = [item.object_id for item in setup.objects if item.split == "train"]
    dropped = set(learned[1::2]) if variant.share < 1 else set()
    assignments = [*setup.assignments, *variant.assignments]
    for stage in ("train-unet", "train-gcn"):
        epochs = max(1, round(variant.epochs * setup.settings(stage).epochs))  # type: ignore[attr-defined]
        assignments.append(f"{stage}.epochs={epochs}")
    if variant.coarse < 1:
        named = setup.settings("simulate-grasps").sensor or "gel_16mm"  # type: ignore[attr-defined]
        sensor = load_sensor(named)
        rows, cols = (max(16, round(variant.coarse * size)) for size in sensor.shape)
        described = sensor.model_copy(update={"name": f"{sensor.name}_coarse", "rows": rows, "cols": cols}).model_dump(
            mode="json", exclude_none=True, by_alias=True
        )
        data.mkdir(parents=True, exist_ok=True)
        (file := data.parent / "coarse.yaml").write_text(yaml.safe_dump(described))
        assignments.append(f"simulate-grasps.sensor={file.resolve()}")
    kept = [item for item in setup.objects if item.object_id not in dropped]
    return replace(setup, objects=kept, assignments=tuple(assignments))


def _measure(label: str, setup: Setup, chain: list[str], data: Path, console: Console) -> Point:
    seconds = 0.0
    errors: dict[str, list[float]] = {}
    for name in chain:
        stage, settings = load_stage(name), setup.settings(name)
        for training in range(TRAININGS) if name in ("train-gcn", "evaluate") else (None,):
            if training is not None:
                settings = setup.settings(name, {"training_seed": training})
            setup.make(name, settings, data, Console(quiet=True) if name == "evaluate" else console)  # its tables say little here
            if name == "evaluate":
                for object_id, value in chamfer_by_object(DataDirectory(data).whole_folder(evaluation_name(training or 0))).items():
                    errors.setdefault(object_id, []).append(value)
            else:
                count, _ = stage.cost_of(settings, setup.objects)
                times = times_of(stage, settings, data, count if isinstance(stage, DatasetStage) else 0)
                seconds += count * sum(times.values()) / len(times)
    size = sum(
        kilobytes(data, load_stage(name).writes(setup.settings(name))) for name in chain if not isinstance(load_stage(name), DatasetStage)
    )
    return Point(
        label=label,
        changes={"variant": label} if label != "your settings" else {},
        times={"all": seconds},
        kilobytes=size,
        errors={name: tuple(values) for name, values in errors.items()},
    )


def _foreseen(setup: Setup) -> float:
    """Foresee the seconds of all variants on one core."""
    chain = [*stages_before("evaluate", setup), "evaluate"]
    once = sum(setup.seconds(name, setup.settings(name)) for name in chain)
    return len(VARIANTS) * (once + (TRAININGS - 1) * sum(setup.seconds(name, setup.settings(name)) for name in ("train-gcn", "evaluate")))
