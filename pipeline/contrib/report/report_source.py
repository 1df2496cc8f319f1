"""Read the content of a report: artifacts of a data directory, and the figures of each object in its evaluation."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.console import Row, Table, pluralise
from pipeline.contrib.report.results import Results
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.dataset.object_rows import is_surface
from pipeline.drawing.colors import TOUCH_COLOR, VISION_COLORS
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.store.directory import Collection
from pipeline.store.storage import Location
from pipeline.tables.comparison import difference, scores
from pipeline.tables.evaluation_tables import ACCURACY
from stages.evaluate.evaluation_files import (
    SHIPPED_SCORES,
    Arrays,
    Figures,
    evaluations,
    read_figures,
    read_root,
    read_surfaces,
    read_table,
    surface_of,
)

SHOWN_METRICS = {**dict(ACCURACY.values()), "chamfer": TABLE_3_FACTOR}
"""The metrics of single objects, and the factors to their units."""


class Picture(NamedTuple):
    """A picture of a page."""

    file: str  # below the report's folder
    alt: str
    caption: str = ""


class ReportSource(CompletedObjects):
    """The artifacts of a data directory that a report shows, and its results.

    `measured` are those that keep surfaces, which are shown: the first evaluation, and the score of the pretrained
    network; `evaluation` is their content, None if no network has been evaluated.
    """

    def __init__(self, data: Location, results: Results | None = None) -> None:
        super().__init__(data, ("surfaces", "grasps", "touch"), ("vision", "charts", "slides"))
        self.results = results or Results(
            self.directory, evaluations(self.directory), [name for name, problem in scores(self.directory).items() if not problem]
        )
        self.measured = [*self.results.evaluated[:1], *(name for name in self.results.scored if name == SHIPPED_SCORES)]
        folders = [self.directory.verified_folder(name) for name in self.measured]
        self.evaluation = Evaluation(folders, self.collections.get("charts")) if folders else None


class ShownSurface(NamedTuple):
    """The reconstruction of an object from its first grasps."""

    network: str  # configuration
    grasps: int  # that its figures are of
    felt: bool  # the network was given touches
    case: int  # its number in the network's group of surfaces
    figures: Mapping[str, float]  # by metric
    inputs: str  # the network and the grasps that it was given

    @property
    def name(self) -> str:
        """Name it as CONFIGURATION-GRASPS."""
        return f"{self.network}-{self.grasps}"

    @property
    def error(self) -> str:
        """Write its mean distance."""
        return f"{1e3 * self.figures['mean_distance']:.1f} mm"


class Evaluation:
    """The results of single objects: surfaces (`tables`) and `figures`, by network whose surfaces are stored."""

    def __init__(
        self,
        folders: Sequence[Path],  # an evaluation, and scores with surfaces; those not comparable are skipped
        fitted: Collection | None = None,  # the artifact `charts`
    ) -> None:
        self.fitted = fitted
        self.object_ids = [str(name) for name in read_table(folders[0], "objects")["object_id"]]
        self.tables: dict[str, Arrays] = {}
        self.figures: dict[str, Figures] = {}
        for folder in folders:
            if difference(folders[0], folder) is None:
                figures = read_figures(folder)
                for name in read_root(folder)["configurations"]:
                    if surfaces := read_surfaces(folder, name):
                        self.tables[name], self.figures[name] = surfaces, figures[name]
        self.configurations = list(self.tables)
        self._row = {object_id: row for row, object_id in enumerate(self.object_ids)}

    def predictions(self, object_id: str) -> list[ShownSurface]:
        """List the reconstructions of an object with its first grasps, by network from few grasps to many; none if it was not evaluated."""
        if object_id not in self._row:
            return []
        row, predictions = self._row[object_id], []
        for name, table in self.tables.items():
            cases = [case for case, first_grasp in enumerate(table["first_grasp"]) if first_grasp == 0]
            for case in sorted(cases, key=lambda case: int(table["grasps_given"][case])):
                felt, count = bool(table["grasps_given"][case]), max(int(table["grasps_given"][case]), 1)
                figures = {metric: float(self.figures[name].per_case(metric, count)[row, 0]) for metric in SHOWN_METRICS}
                inputs = name + (f", {pluralise(count, 'grasp')}" if felt else "")
                predictions.append(ShownSurface(name, count, felt, case, figures, inputs))
        return predictions

    def ranked(self, names: Sequence[str]) -> list[str]:
        """Sort the objects by the mean distance of these networks' reconstructions from their first grasps, the nearest first."""

        def error(object_id: str) -> float:
            predictions = [prediction for prediction in self.predictions(object_id) if prediction.network in names]
            return float(np.mean([prediction.figures["mean_distance"] for prediction in predictions]))

        return sorted(self.object_ids, key=error)

    def surface(self, object_id: str, prediction: ShownSurface) -> tuple[np.ndarray, np.ndarray]:  # (V, 3) m, (F, 3)
        """Read the surface of a reconstruction."""
        table = self.tables[prediction.network]
        return surface_of(table, self._row[object_id], prediction.case)

    def mesh(self, object_id: str, prediction: ShownSurface) -> Mesh:
        """Make the mesh of a reconstruction: in grey, with the touch charts of its input, if these are fitted, in orange."""
        vertices, faces = ([part] for part in self.surface(object_id, prediction))
        table = self.tables[prediction.network]
        count, first_grasp = (int(table[name][prediction.case]) for name in ("grasps_given", "first_grasp"))
        if count and self.fitted is not None and "position" in table:  # touch charts are not part of a mesh
            row = self.fitted.view(object_id)
            charts, touched = row["vertices"], is_surface(row["stop_rule"])  # (grasp, sensor, S, 3), (grasp, sensor)
            grasps = [(first_grasp + step) % len(charts) for step in range(count)]
            vertices += list(charts[grasps][touched[grasps]])
            faces += [row["chart_faces"]] * (len(vertices) - 1)
        points, triangles = trimesh.util.append_faces(vertices, faces)
        return two_coloured(points, triangles, len(faces[0]))


def painted_mesh(
    vertices: NDArray[np.floating],  # (V, 3) m
    faces: NDArray[np.integer],  # (F, 3)
    material: NDArray[np.integer] | NDArray[np.bool_],  # (F,) numbers of colours
    colors: Sequence[tuple[int, ...]],  # RGBA, 0 to 255
) -> Mesh:
    """Make a mesh in plain colours."""
    look = Look(
        uv=np.zeros((len(vertices), 2), np.float32),
        face_material=material.astype(np.int32),
        base_color=np.array(colors, np.uint8),
        material_texture=np.full(len(colors), -1, np.int32),
    )
    return Mesh(vertices.astype(np.float64), faces.astype(np.int32), look)


def two_coloured(
    vertices: np.ndarray,  # (V, 3) m
    faces: np.ndarray,  # (F, 3)
    grey: int,  # number of the first faces that are grey; the others, of touch charts, are orange
) -> Mesh:
    """Make a mesh of vision charts and touch charts."""
    return painted_mesh(vertices, faces, np.arange(len(faces)) >= grey, [VISION_COLORS[0], TOUCH_COLOR])


def best(predictions: Iterable[ShownSurface]) -> ShownSurface:
    """Choose the reconstruction of the least mean distance."""
    return min(predictions, key=lambda prediction: prediction.figures["mean_distance"])


def errors_table(predictions: Sequence[ShownSurface]) -> Table:
    """Make the table of the accuracy of an object's reconstructions."""
    rows = [
        Row([shown.network, shown.grasps * shown.felt, *(factor * shown.figures[metric] for metric, factor in SHOWN_METRICS.items())])
        for shown in predictions
    ]
    columns = ["network", "grasps given", *ACCURACY, f"Chamfer distance × {TABLE_3_FACTOR:.0f}, m²"]
    return Table("", columns, rows, ["", "", ".2f", ".1f", ".1f", ".3f"])
