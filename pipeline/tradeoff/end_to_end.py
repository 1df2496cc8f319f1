"""Measure how variants of a dataset change the reconstructions that networks learn from it."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml
from rich.console import Console

from pipeline.config.sources import Object
from pipeline.engine import keys
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.touch.sensor import Sensor, resample
from pipeline.store import digest
from pipeline.store.directory import DataDirectory
from pipeline.tradeoff.measure import Setup, dependencies, kilobytes, linked_copy, stages_before, times_of
from pipeline.tradeoff.measured import END_TO_END, FOLDER, MeasuredTrade, Point
from pipeline.tradeoff.sample import affordable
from pipeline.tradeoff.sweep import file_name
from stages.evaluate.evaluation_files import chamfer_by_object, evaluation_name
from stages.registry import load_stage

NETWORK = ("train-gcn.configuration=occluded-touch", "evaluate.configurations=[occluded-touch]", "evaluate.grasps=[1, 2]")
"""A network with vision and touch; it is evaluated with one and two grasps, which every variant has."""
TRAININGS = 3
"""Trainings of each network, with different seeds."""


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
    """Measure every variant, or read it if it is measured under the same key; a killed measurement continues.

    The trade is also written below the data directory. Times and sizes are those of all objects and trainings together.
    """
    setup = replace(setup, network=NETWORK)
    variants = _variants(setup)

    def foreseen(sample: Sequence[Object]) -> float:
        return len(variants) * _seconds(setup.with_objects(sample))

    setup = setup.with_objects(affordable(setup.objects, setup.seed, seconds, foreseen))
    minutes = foreseen(setup.objects) / 60
    console.print(f"{len(variants)} datasets of {len(setup.objects)} objects: about {minutes:.0f} min, less what is measured")
    folder, learned = setup.data / FOLDER / END_TO_END, sum(item.split == "train" for item in setup.objects)
    metric = f"Chamfer distance x 9000 of test objects, {TRAININGS} trainings"
    facts = {"metric": metric, "unit": "", "cost": "core seconds in all", "trained": learned, "total": len(variants)}
    measured = setup.begin(folder, END_TO_END, _key(setup), **facts)
    measured_labels = {point.label for point in measured.points}
    for label, variant in variants.items():
        if label in measured_labels:
            continue
        data = folder / file_name(label)
        if label != USER_SETTINGS:  # what the variant does not change is reused
            linked_copy(folder / file_name(USER_SETTINGS), _outputs(setup), data)
        measured = measured.with_point(_measure(label, _changed(setup, variant, folder), data, console))
        measured.write(setup.data)
        if label != USER_SETTINGS:
            shutil.rmtree(data)
    shutil.rmtree(folder, ignore_errors=True)
    return measured


def _variants(setup: Setup) -> dict[str, Variant]:
    """List the variants, without coarser touch where fingers wear different sensors: one file describes one."""
    alike = len({sensor.name for sensor in _sensors(setup)}) == 1
    return {label: variant for label, variant in VARIANTS.items() if alike or variant.coarse == 1}


def _chain(setup: Setup) -> list[str]:
    return [*stages_before("evaluate", setup), "evaluate"]


def _outputs(setup: Setup) -> list[str]:
    """List the artifacts of the dataset, without trained networks."""
    stages = [load_stage(name) for name in _chain(setup)]
    return [stage.writes(setup.settings(stage.name)) for stage in stages if stage.per_object]


def _key(setup: Setup) -> str:
    return digest.of_json([dependencies(_chain(setup), setup), setup.seed, keys.sources_hash(__name__)])


def _seconds(setup: Setup) -> float:
    """Foresee the seconds of a variant on one core."""
    repeats = {"train-gcn": TRAININGS, "evaluate": TRAININGS}
    return sum(repeats.get(name, 1) * setup.seconds(name, setup.settings(name)) for name in _chain(setup))


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
        (folder / "coarse.png").write_bytes(coarse.photograph)
        described["calibrated"] |= {"background": "coarse.png"}
    (file := folder / "coarse.yaml").write_text(yaml.safe_dump(described))
    return file


def _measure(label: str, setup: Setup, data: Path, console: Console) -> Point:
    """Make a dataset, train and evaluate its networks, and add up the time of everything but the evaluation."""
    seconds = 0.0
    errors: dict[str, list[float]] = {}
    for name in _chain(setup):
        stage = load_stage(name)
        for training in range(TRAININGS) if name in ("train-gcn", "evaluate") else (0,):
            settings = setup.settings(name, {"training_seed": training} if name in ("train-gcn", "evaluate") else {})
            setup.make(name, settings, data, Console(quiet=True) if name == "evaluate" else console)  # its tables say little here
            if name == "evaluate":
                for object_id, value in chamfer_by_object(DataDirectory(data).verified_folder(evaluation_name(training))).items():
                    errors.setdefault(object_id, []).append(value)
            else:
                count, _ = stage.cost_of(settings, setup.objects)
                times = times_of(stage, settings, data, 0 if stage.per_object else count)
                seconds += count * sum(times.values()) / max(len(times), 1)
    return Point(
        label=label,
        changes={} if label == USER_SETTINGS else {"variant": label},
        times={"all": seconds},
        kilobytes=sum(kilobytes(data, output) for output in _outputs(setup)),
        errors={name: tuple(values) for name, values in errors.items()},
    )
