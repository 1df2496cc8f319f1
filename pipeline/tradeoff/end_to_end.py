"""Measure how variants of a dataset change the reconstructions that networks learn from it."""

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from PIL import Image
from rich.console import Console

from pipeline.engine import keys
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.touch.sensor import Sensor, resample
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff.measure import Setup, linked_copy, measure_points, stages_before, trade_key
from pipeline.tradeoff.sweep import file_name
from pipeline.tradeoff.trades import END_TO_END, MeasuredTrade, Point, kilobytes, times_of
from stages.evaluate.evaluation_files import chamfer_by_object, evaluation_name
from stages.registry import load_stage

NETWORK = ("train-gcn.configuration=occluded-touch", "evaluate.configurations=[occluded-touch]", "evaluate.grasps=[1, 2]")
"""A network with vision and touch; it is evaluated with one and two grasps, which every variant has."""
TRAININGS, REPEATED = 3, ("train-gcn", "evaluate")  # trainings of each network, with different seeds; and the stages that are run for each


@dataclass(frozen=True)
class Variant:
    """A dataset that differs from the user's in one respect."""

    assignments: tuple[str, ...] = ()  # settings that differ from the user's
    share: float = 1.0  # of the training objects
    epochs: float = 1.0  # factor of the epochs of all trainings
    coarse: float = 1.0  # factor of the sensor's rows and columns


USER_SETTINGS = "your settings"
VARIANTS: Mapping[str, Variant] = {
    USER_SETTINGS: Variant(),
    "half the objects": Variant(share=0.5),
    "two grasps per object": Variant(("simulate-grasps.grasps=2",)),
    "images of 192 pixels": Variant(("render-vision.resolution=192",)),
    "touch of half the pixels a side": Variant(coarse=0.5),
    "depth in steps of 61 um": Variant(("simulate-touch.gel_bits=14", "simulate-touch.far_bits=14")),
    "half the epochs": Variant(epochs=0.5),
    "twice the epochs": Variant(epochs=2.0),
}


def measure_end_to_end(
    setup: Setup,  # all objects, and the user's settings
    seconds: float,  # for all of it; the sample is as large as this allows
    console: Console,
) -> MeasuredTrade:
    """Measure every variant, as `measure_points`. Times and sizes are those of all objects and trainings together."""
    setup = replace(setup, network=NETWORK)
    chain = [*stages_before("evaluate", setup), "evaluate"]
    alike = len({sensor.name for sensor in _sensors(setup)}) == 1  # one file describes a coarser sensor
    variants = {label: variant for label, variant in VARIANTS.items() if alike or variant.coarse == 1}
    outputs = [stage.writes(setup.settings(stage.name)) for stage in map(load_stage, chain) if stage.per_object]

    def foreseen(sample: Setup) -> float:
        """Foresee the seconds of all variants on one core."""
        return len(variants) * sum((TRAININGS if name in REPEATED else 1) * sample.seconds(name) for name in chain)

    setup = setup.affordable(seconds, foreseen)
    minutes = foreseen(setup) / 60
    console.print(f"{len(variants)} datasets of {len(setup.objects)} objects: about {minutes:.0f} min, less what is measured")

    def measure(label: str, folder: Path) -> tuple[Point, dict[str, Any]]:
        data = folder / file_name(label)
        if label != USER_SETTINGS:  # what the variant does not change is reused
            linked_copy(folder / file_name(USER_SETTINGS), outputs, data)
        times, errors = _run(chain, _changed(setup, variants[label], folder), data, console)
        size, changes = sum(kilobytes(data, output) for output in outputs), {} if label == USER_SETTINGS else {"variant": label}
        if label != USER_SETTINGS:
            shutil.rmtree(data)
        return Point(label=label, changes=changes, times={"all": times}, kilobytes=size, errors=errors), {}

    facts = {
        "metric": f"Chamfer distance x 9000 of test objects, {TRAININGS} trainings",
        "unit": "",
        "cost": "core seconds in all",
        "trained": sum(item.split == "train" for item in setup.objects),
    }
    key = trade_key(chain, setup, keys.sources_hash(__name__))
    return measure_points(setup, END_TO_END, key, list(variants), measure, math.inf, **facts)


def _changed(setup: Setup, variant: Variant, folder: Path) -> Setup:
    """Apply a variant to a setup; a coarser sensor is described by a file in the folder."""
    learned = [item.object_id for item in setup.objects if item.split == "train"]
    dropped = set(learned[1::2]) if variant.share < 1 else set()
    assignments = [*setup.assignments, *variant.assignments]
    for stage in ("train-unet", "train-gcn"):
        assignments.append(f"{stage}.epochs={max(1, round(variant.epochs * setup.settings(stage).results()['epochs']))}")
    if variant.coarse < 1:
        assignments.append(f"simulate-grasps.sensor={coarse_sensor(_sensors(setup)[0], variant.coarse, folder).resolve()}")
    return replace(setup, objects=[item for item in setup.objects if item.object_id not in dropped], assignments=tuple(assignments))


def _sensors(setup: Setup) -> tuple[Sensor, ...]:
    """Load the sensors that the hand wears, by mount."""
    settings = setup.settings("simulate-grasps").results()
    return load_worn_sensors(sensor_names(load_hand(settings["hand"]), settings["sensor"]))


def coarse_sensor(sensor: Sensor, share: float, folder: Path) -> Path:
    """Describe a sensor with that share of its rows and columns in a file in the folder."""
    coarse = resample(sensor, *(max(2, round(share * size)) for size in sensor.shape))
    described = {**coarse.model_dump(mode="json", exclude_none=True, by_alias=True), "name": f"{sensor.name}_coarse"}
    folder.mkdir(parents=True, exist_ok=True)
    if coarse.photograph is not None:
        Image.frombytes("RGB", (coarse.cols, coarse.rows), coarse.photograph).save(folder / "coarse.png")
        described["calibrated"] |= {"background": "coarse.png"}
    (file := folder / "coarse.yaml").write_text(yaml.safe_dump(described))
    return file


def _run(
    chain: Sequence[str], setup: Setup, data: Path, console: Console
) -> tuple[float, dict[str, tuple[float, ...]]]:  # core seconds of all but the evaluation; errors by object, one per training
    """Make a dataset, train and evaluate its networks."""
    seconds = 0.0
    errors: dict[str, tuple[float, ...]] = {}
    for name in chain:
        stage = load_stage(name)
        for training in range(TRAININGS) if name in REPEATED else (0,):
            settings = setup.settings(name, {"training_seed": training} if name in REPEATED else {})
            setup.make(name, settings, data, Console(quiet=True) if name == "evaluate" else console)  # its tables say little here
            if name == "evaluate":
                for object_id, value in chamfer_by_object(DataDirectory(data).verified_folder(evaluation_name(training))).items():
                    errors[object_id] = (*errors.get(object_id, ()), value)
            else:
                count, _ = stage.cost_of(settings, setup.objects)
                times = times_of(stage, settings, data, 0 if stage.per_object else count)
                seconds += count * sum(times.values()) / max(len(times), 1)
    return seconds, errors
