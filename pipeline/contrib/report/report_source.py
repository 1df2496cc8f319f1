"""Read the content of a report: artifacts of a data directory, and the figures of each object in its evaluation."""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.console import Row, Table, pluralise
from pipeline.dataset.grasping_hand import grasping_hand
from pipeline.dataset.touch_sensors import touch_sensors
from pipeline.dataset.touch_statistics import Tally, tally
from pipeline.dataset.vision_scene import dataset_scene
from pipeline.errors import StoreError
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.scene import Scene
from pipeline.store.directory import DataDirectory
from pipeline.store.origins import check_origins
from pipeline.store.storage import Location
from pipeline.tables.training_seeds import scores
from schemas.catalogue import ARTIFACTS
from schemas.vision import VISION
from stages.evaluate.comparison import difference
from stages.evaluate.evaluation_files import (
    Arrays,
    Figures,
    evaluations,
    has_surfaces,
    read_figures,
    read_root,
    read_surfaces,
    read_table,
    surface_of,
)
from stages.evaluate.settings import SHIPPED_SCORES
from stages.evaluate.tables import ACCURACY

NEEDED, SHOWN = ("surfaces", "grasps", "touch"), ("vision", "charts")
"""Artifacts that a report needs, and those that it shows if they have been made."""

SHOWN_METRICS = {**dict(ACCURACY.values()), "chamfer": TABLE_3_FACTOR}
"""The metrics of single objects, and the factors to their units."""


class ReportSource:
    """The artifacts of a data directory that a report shows.

    `evaluated` are the names of the evaluations, one per training seed, `scored` those of the scores of other methods.
    `measured` are those of them that keep surfaces, which are shown: the first evaluation, and the score of the network
    that ships; `evaluation` is their content, None if no network has been evaluated.
    """

    def __init__(self, data: Location) -> None:
        self.directory = DataDirectory(data)
        collections = {name: self.directory.collection(ARTIFACTS[name]) for name in (*NEEDED, *SHOWN)}
        self.collections = {name: collection for name, collection in collections.items() if name in NEEDED or collection.shards}
        for collection in self.collections.values():
            collection.first  # noqa: B018 (an error where it has not been made)
        self.evaluated, self.scored = evaluations(self.directory), scores(self.directory)
        check_origins(self.directory, [*self.collections, *self.evaluated])
        names = [*self.collections["surfaces"], *self.collections["surfaces"].missing]
        failures = {name: why for name in names for collection in self.collections.values() if (why := collection.failure(name))}
        self.failures = {name: (why.stage, why.reason) for name, why in failures.items()}  # of the others
        self.object_ids = [name for name in names if name not in failures]  # that failed in none of the artifacts
        if not self.object_ids:
            raise StoreError(f"{data.resolve()}: no object came through all stages; `vt-pipeline status {shlex.quote(str(data))}` says why")
        self.measured = [*self.evaluated[:1], *(name for name in self.scored if name == SHIPPED_SCORES)]
        self.evaluation = Evaluation([self.directory.verified_folder(name) for name in self.measured]) if self.measured else None

    def rows(self, object_id: str) -> dict[str, Mapping[str, np.ndarray]]:
        """Open an object's rows, by artifact; each array is read once."""
        return {name: collection.view(object_id) for name, collection in self.collections.items()}

    def attributes(self, artifact: str) -> Mapping[str, Any]:
        """Read the attributes of an artifact."""
        return self.collections[artifact].first.attributes

    @cached_property
    def tallies(self) -> dict[str, Tally]:
        """The touches of all grasps, by category."""
        return tally(self.directory.root)

    @property
    def name(self) -> str:
        """The manifest's name, and the preset's."""
        return f"{self.attributes('grasps')['manifest']} · {self.collections['grasps'].first.record.preset}"

    def hand(self) -> Hand:
        """Load the hand that grasped."""
        return grasping_hand({name: self.attributes(name) for name in self.collections})

    def sensors(self) -> tuple[Sensor, ...]:
        """List the sensor of each finger."""
        return touch_sensors(self.attributes("touch"))

    def digests(self, object_id: str) -> dict[str, str]:
        """Collect the digests of an object's rows, by artifact."""
        return {name: collection.row(object_id).digest for name, collection in self.collections.items()}


def shown_scene(directory: DataDirectory) -> Scene:
    """Read the scene that a dataset's images show; load the supplement's for a dataset without images."""
    images = directory.collection(VISION).shards
    return dataset_scene(images[0].attributes) if images else load_scene("supplement")


class Prediction(NamedTuple):
    """Hold the reconstruction of an object from its first grasps."""

    network: str  # configuration
    grasps: int  # that its figures are of
    felt: bool  # the network was given touches
    case: int  # its number in the network's group of surfaces
    figures: Mapping[str, float]  # by metric

    @property
    def name(self) -> str:
        """Name it as CONFIGURATION-GRASPS."""
        return f"{self.network}-{self.grasps}"

    @property
    def label(self) -> str:
        """Name the reconstruction for a reader."""
        given = f", {pluralise(self.grasps, 'grasp')}" if self.felt else ""
        return f"{self.network}{given}, {1e3 * self.figures['mean_distance']:.1f} mm"


class Evaluation:
    """Read the results of single objects: surfaces (`tables`) and `figures`, by network whose surfaces are stored."""

    def __init__(
        self,
        folders: Sequence[Path],  # an evaluation, and scores with surfaces; those not comparable are skipped
    ) -> None:
        self.object_ids = [str(name) for name in read_table(folders[0], "objects")["object_id"]]
        self.tables: dict[str, Arrays] = {}
        self.figures: dict[str, Figures] = {}
        for folder in folders:
            if difference(folders[0], folder) is None:
                figures = read_figures(folder)
                for name in read_root(folder)["configurations"]:
                    if has_surfaces(folder, name):
                        self.tables[name], self.figures[name] = read_surfaces(folder, name), figures[name]
        self.configurations = list(self.tables)

    def predictions(self, object_id: str) -> list[Prediction]:
        """List the reconstructions of an object with its first grasps; none if it was not evaluated."""
        if object_id not in self.object_ids:
            return []
        row, predictions = self.object_ids.index(object_id), []
        for name, table in self.tables.items():
            cases = [case for case, first_grasp in enumerate(table["first_grasp"]) if first_grasp == 0]
            for case in sorted(cases, key=lambda case: int(table["grasps_given"][case])):
                grasp_count = max(int(table["grasps_given"][case]), 1)
                figures = {metric: float(self.figures[name].per_case(metric, grasp_count)[row, 0]) for metric in SHOWN_METRICS}
                predictions.append(Prediction(name, grasp_count, bool(table["grasps_given"][case]), case, figures))
        return predictions

    def ranked(self, names: Sequence[str]) -> list[str]:
        """Sort the objects by the mean distance of these networks' reconstructions from their first grasps, the nearest first."""

        def error(object_id: str) -> float:
            return float(
                np.mean([prediction.figures["mean_distance"] for prediction in self.predictions(object_id) if prediction.network in names])
            )

        return sorted(self.object_ids, key=error)

    def surfaces(self, object_id: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Read the vertices (V, 3), m, and faces (F, 3) of these reconstructions, by name."""
        surfaces = {}
        for prediction in self.predictions(object_id):
            table = self.tables[prediction.network]
            surfaces[prediction.name] = surface_of(table, table["object_id"].tolist().index(object_id), prediction.case)
        return surfaces


def best(predictions: Iterable[Prediction]) -> Prediction:
    """Choose the reconstruction of the least mean distance."""
    return min(predictions, key=lambda prediction: prediction.figures["mean_distance"])


def errors_table(predictions: Sequence[Prediction]) -> Table:
    """Make the table of the accuracy of an object's reconstructions."""
    rows = []
    for prediction in predictions:
        cells = [factor * prediction.figures[metric] for metric, factor in SHOWN_METRICS.items()]
        rows.append(Row([prediction.network, prediction.grasps if prediction.felt else 0, *cells]))
    columns = ["network", "grasps given", *ACCURACY, f"Chamfer distance × {TABLE_3_FACTOR:.0f}, m²"]
    return Table("", columns, rows, ["", "", ".2f", ".1f", ".1f", ".3f"])
