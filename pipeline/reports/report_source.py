"""The content of a report: artifacts of a data directory, and the figures of each object in its evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import Row, Table
from pipeline.dataset.grasping_hand import grasping_hand
from pipeline.dataset.touch_sensors import touch_sensors
from pipeline.errors import StoreError
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.kernels.touch.sensor import Sensor
from pipeline.reports.training_seeds import evaluations
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Place
from schemas.catalogue import ARTIFACTS
from stages.evaluate.evaluation_files import Arrays, read_figures, read_root, read_surfaces, read_table, surface_of

NEEDED, SHOWN = ("surfaces", "grasps", "touch"), ("vision", "charts")
"""Artifacts that a report needs, and those that it shows if they have been made."""


class ReportSource:
    """The artifacts of a data directory that a report shows.

    Attributes
    ----------
    directory
        The data directory.
    collections
        The artifacts by name.
    object_ids
        The objects that failed in none of them.
    failures
        Stage and reason, by object, of the others.
    evaluated
        The names of the evaluations, one per training seed.
    evaluation
        The first of them; None where no network has been evaluated.

    Raises
    ------
    StoreError
        An artifact of `NEEDED` is missing, an artifact is out of date, or no object came through all stages.
    """

    def __init__(self, data: Place) -> None:
        self.directory = DataDirectory(data)
        collections = {name: self.directory.collection(ARTIFACTS[name]) for name in (*NEEDED, *SHOWN)}
        self.collections = {name: collection for name, collection in collections.items() if name in NEEDED or collection.shards}
        for collection in self.collections.values():
            collection.first  # noqa: B018 (an error where it has not been made)
        self.evaluated = evaluations(self.directory)
        self.directory.check_origins([*self.collections, *self.evaluated])
        names = [*self.collections["surfaces"], *self.collections["surfaces"].missing]
        failures = {name: why for name in names for collection in self.collections.values() if (why := collection.failure(name))}
        self.failures = {name: (why.stage, why.reason) for name, why in failures.items()}
        self.object_ids = [name for name in names if name not in failures]
        if not self.object_ids:
            raise StoreError(f"{data.resolve()}: no object came through all stages; `vt-pipeline status` says why")
        self.evaluation = Evaluation(self.directory.whole_folder(self.evaluated[0])) if self.evaluated else None

    def rows(self, object_id: str) -> dict[str, Mapping[str, np.ndarray]]:
        """Open an object's rows, by artifact; each array is read once."""
        return {name: collection.view(object_id) for name, collection in self.collections.items()}

    def attributes(self, artifact: str) -> Mapping[str, Any]:
        """Read the attributes of an artifact."""
        return self.collections[artifact].first.attributes

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


class Evaluation:
    """Read the results of single objects from an evaluation folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.configurations = list(read_root(folder)["configurations"])
        self.object_ids = [str(name) for name in read_table(folder, "objects")["object_id"]]
        self._surfaces = {name: read_surfaces(folder, name) for name in self.configurations}
        figures = read_figures(folder)
        self._figures = {name: figures[name] for name in self.configurations}

    def surfaces(self, object_id: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Read the predicted surfaces of an object with its first grasps, as CONFIGURATION-GRASPS; none if it was not evaluated."""
        if object_id not in self.object_ids:
            return {}
        surfaces = {}
        for name, table in self._surfaces.items():
            number = table["object_id"].tolist().index(object_id)
            for case in _first_cases(table):
                surfaces[f"{name}-{max(int(table['grasps_given'][case]), 1)}"] = surface_of(table, number, case)
        return surfaces

    def errors(self, object_id: str) -> Table | None:
        """Make the table of an object's Chamfer distances with its first grasps, in Table 3's unit; None if it was not evaluated."""
        if object_id not in self.object_ids:
            return None
        row, given = self.object_ids.index(object_id), max((figures.grasps for figures in self._figures.values()), key=len)
        rows = []
        for name, figures in self._figures.items():
            first = {number: TABLE_3_FACTOR * figures.per_case("chamfer", number)[row, 0] for number in figures.grasps}
            rows.append(Row([name, *(first.get(number, "") for number in given)]))
        title = f"Chamfer distance × {TABLE_3_FACTOR:.0f} by the number of grasps given"
        return Table(title, ["network", *map(str, given)], rows, ["", *[".3f"] * len(given)])


def _first_cases(table: Arrays) -> list[int]:
    """List the cases that begin with the first grasp, by the number of grasps given."""
    cases = [case for case, first in enumerate(table["first_grasp"]) if first == 0]
    return sorted(cases, key=lambda case: int(table["grasps_given"][case]))
