"""Measure errors by number of training objects, and by kind of input: `python -m benchmarks.learning_curve DATA OUT --objects 168 500`.

Trains implicit networks on these numbers of training objects, from each class in turn, and measures them on the test objects.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch

from benchmarks.provenance import commit, machine
from benchmarks.timing import Table
from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR, cloud_distances
from pipeline.kernels.networks.implicit_network import ImplicitNetwork
from pipeline.kernels.networks.network_configurations import ImplicitConfig
from pipeline.models.families import ROWS, load_reconstructor
from pipeline.models.model_files import save_model
from pipeline.models.observation import observed_arrays, stored_observation
from pipeline.rng import numpy_rng, torch_generator
from pipeline.store import digest
from pipeline.store.storage import as_location
from pipeline.training.items import Items
from pipeline.training.loop import train
from stages.evaluate.measure import sample_reconstruction
from stages.registry import resolve
from stages.train_implicit import ImplicitLearner, ImplicitSettings, TrainImplicit

ANY = "implicit-any"
POINTS = 10_000
DONE = "figures.json"
"""File of a trained and measured network's errors, by the inputs it was given; it marks the folder as finished."""


@dataclass(frozen=True)
class Experiment:
    """Hold what all trainings share: the datasets to learn from and to test on, the folder of networks, and settings."""

    data: Path
    tested: Path
    out: Path
    classes: Sequence[str]
    ways: Sequence[str]
    assignments: Sequence[str]

    def figures(self, configuration: str, count: int, epochs: int, seed: int) -> dict[str, list[float]]:
        """Train a network on a number of objects unless it is trained; return its errors for each kind of input."""
        shared = digest.of_json([str(self.data), str(self.tested), [*self.classes], [*self.ways], [*self.assignments]])
        folder = self.out / f"{configuration}-{count}-{epochs}-{seed}-{shared[:8]}"
        if not (folder / DONE).exists():
            changes = [f"configuration={configuration}", f"epochs={epochs}", f"training_seed={seed}", *self.assignments]
            settings = resolve(TrainImplicit.name, "draft", [f"{TrainImplicit.name}.{text}" for text in changes])
            assert isinstance(settings, ImplicitSettings)
            self.learn(folder, settings, count)
            configurations = [f"{ANY}-{way}" for way in self.ways] if configuration == ANY else [configuration]
            (folder / DONE).write_text(json.dumps({way: self.errors(folder, way) for way in configurations}))
        errors_by_way: dict[str, list[float]] = json.loads((folder / DONE).read_text())
        return errors_by_way

    def learn(self, folder: Path, settings: ImplicitSettings, count: int) -> None:
        """Train a network and save it in a folder."""
        learning, validation = (
            Items(
                as_location(self.data),
                split,
                settings.inputs,
                items,
                learned=TrainImplicit.arrays,
                cache_megabytes=settings.cache_megabytes,
            )
            for split, items in (("train", settings.samples_per_object), ("valid", settings.validation_items))
        )
        learning.rows.object_ids = self.spread(learning.rows, count)
        validation.rows.object_ids = self.spread(validation.rows)
        name, seed = folder.name, settings.training_seed
        config = cast(ImplicitConfig, settings.network(learning.side))
        network = ImplicitNetwork(config, torch_generator(seed, name, "weights"))
        folder.mkdir(parents=True, exist_ok=True)
        train(ImplicitLearner(network, learning, validation, settings, seed), settings, folder=folder, seed=seed, name=name)
        save_model(folder, network, learning.trained(settings.configuration, network.config))

    def spread(self, rows: ObjectRows, count: int | None = None) -> list[str]:
        """Choose a number of objects, or all, from each class in turn, in a fixed random order: smaller sets are part of larger ones."""
        by_class = defaultdict[str, list[str]](list)
        for category, object_id in zip(rows.categories, rows.object_ids, strict=True):
            if not self.classes or category in self.classes:
                by_class[category].append(object_id)
        ordered = [
            (position, members[number])
            for class_name, members in by_class.items()
            for position, number in enumerate(numpy_rng(0, class_name).permutation(len(members)))
        ]
        if len(ordered) < (count or 1):
            raise SystemExit(f"{rows.data} has {len(ordered)} such objects in split {rows.split}, not {count}")
        return sorted(object_id for _, object_id in sorted(ordered)[:count])

    def errors(self, folder: Path, configuration: str) -> list[float]:
        """Measure the Chamfer distance x 9000 of each test object, given one grasp."""
        model = load_reconstructor(configuration, folder)
        rows = ObjectRows(as_location(self.tested), [*observed_arrays(ROWS[configuration].inputs), "points"], "test")
        distances = []
        for object_id in self.spread(rows):
            (reconstruction,) = model.reconstruct([stored_observation(rows, object_id, [0], model.config)])
            points, _ = sample_reconstruction(reconstruction, POINTS, numpy_rng(0, object_id))
            distances.append(TABLE_3_FACTOR * cloud_distances(points, rows.read("points", object_id)[:POINTS]).chamfer)
        return distances


def main() -> None:
    """Print a table with a row per network, number of objects and kind of input."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, help="a dataset with surfaces, images, charts and distances")
    parser.add_argument("out", type=Path, help="folder of the networks; what it holds is not trained again")
    parser.add_argument("--tested", type=Path, help="another dataset, whose test objects are measured")
    parser.add_argument("--classes", nargs="*", default=[], help="by default all")
    parser.add_argument("--objects", type=int, nargs="+", required=True, help="training objects")
    parser.add_argument("--items", type=int, default=40_000, help="that a training sees in all")
    parser.add_argument("--epochs", type=int, help="in place of --items")
    parser.add_argument("--trainings", type=int, default=1)
    parser.add_argument("--configurations", nargs="+", default=[ANY])
    parser.add_argument("--ways", nargs="+", default=["unoccluded", "occluded-touch"], help=f"to use {ANY}")
    parser.add_argument("--set", nargs="*", default=[], help="further settings of train-implicit")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    experiment = Experiment(
        arguments.data, arguments.tested or arguments.data, arguments.out, arguments.classes, arguments.ways, arguments.set
    )
    table = Table("Errors by what was learned from", ["objects", "epochs", "mean", "of each training", "median"])
    for configuration in arguments.configurations:
        for count in arguments.objects:
            epochs = arguments.epochs or max(1, round(arguments.items / count))
            trainings = [experiment.figures(configuration, count, epochs, seed) for seed in range(arguments.trainings)]
            for way in trainings[0]:
                errors = np.array([training[way] for training in trainings])
                means = ", ".join(f"{mean:.2f}" for mean in errors.mean(axis=1))
                table.add(way, count, epochs, f"{errors.mean():.2f}", means, f"{np.median(errors):.2f}")
    print(table.markdown(f"Chamfer distance x {TABLE_3_FACTOR:g}, {POINTS:,} points, one grasp. Commit {commit()}, {machine()}."))


if __name__ == "__main__":
    main()
