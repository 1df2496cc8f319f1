"""The network, and training objects in its place, on the views of the test objects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.metrics.retrieval import chamfer_matrix, silhouette_overlap
from pipeline.models.observation import stored_observation
from pipeline.models.reconstruction import Reconstructor
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from stages.evaluate_single_image.settings import SingleImageEvaluationSettings
from stages.evaluate_single_image.table_4 import figures_of

ARRAYS = ("points", "rendering", "rendering_camera", "silhouette")
FEW = 1000
"""Points per object by which one is looked up; what is found is measured on all of them."""
STEP = 2
"""Every second pixel of every second row of a silhouette is compared."""


NAME = "evaluate-single-image"


class Measurement:
    """Test objects under Table 4's standard.

    Attributes
    ----------
    rows
        The objects of the test split.
    views
        How many of each are measured.

    Raises
    ------
    StageError
        The dataset has fewer points per object than are asked for.
    """

    def __init__(self, job: DatasetJob) -> None:
        self.job, self.rows = job, ObjectRows(job.data, ARRAYS, "test")
        self.settings: SingleImageEvaluationSettings = job.settings
        if (there := self.rows.size("points", "point")) < self.settings.points:
            raise StageError(f"{NAME}.points is {self.settings.points}, the dataset has {there} per object; lower it")
        self.views = min(self.settings.views, self.rows.size("rendering", "viewpoint"))
        self._surfaces = DataDirectory(job.data).collection(SURFACES)
        self._scales = [self._scale_of(object_id) for object_id in self.rows.object_ids]

    def of_network(self, model: Reconstructor) -> NDArray[np.float64]:
        """Reconstruct each object from each view: the figures (object, view, figure).

        Raises
        ------
        StageError
            A reconstruction is not finite.
        """
        work, found = [(row, view) for row in range(len(self.rows)) for view in range(self.views)], []
        with Meter(self.job.console, NAME, len(work), "views") as meter:
            for start in range(0, len(work), self.settings.batch_size):
                batch = work[start : start + self.settings.batch_size]
                seen = [stored_observation(self.rows, self.rows.object_ids[row], [view], model.config) for row, view in batch]
                for (row, view), made in zip(batch, model.reconstruct(seen), strict=True):
                    name = self.rows.object_ids[row]
                    if not np.isfinite(made.vertices).all():
                        raise StageError(f"the reconstruction of {name}, view {view}, is not finite; was the model trained to the end?")
                    rng = numpy_rng(self.job.seed, NAME, name, view)
                    found.append(self._figures(sample_triangles(made.vertices[made.faces], self.settings.points, rng)[0], row))
                    meter.advance()
        return np.reshape(found, (len(self.rows), self.views, -1))

    def of_baselines(self) -> dict[str, NDArray[np.float64]]:
        """Measure training objects in place of reconstructions, by how they are chosen: the figures (object, view, figure).

        typical
            The one with the least mean distance to the others, whatever the image.
        by silhouette
            The one of which a view has most in common with the image's silhouette (intersection over union).
        by truth
            The nearest one: no retrieval is better.
        """
        known = ObjectRows(self.job.data, ARRAYS, "train")
        names = [known.object_ids[at] for at in np.linspace(0, len(known) - 1, min(len(known), self.settings.looked_up)).astype(int)]
        clouds = [self._points(known, name) for name in names]
        few, asked = [cloud[:FEW] for cloud in clouds], [self._points(self.rows, name)[:FEW] for name in self.rows.object_ids]
        masks = np.concatenate([self._silhouettes(known, name) for name in names])  # (known · view, pixel)
        alike = [silhouette_overlap(self._silhouettes(self.rows, name), masks).argmax(axis=1) for name in self.rows.object_ids]
        size = (len(self.rows), self.views)
        chosen = {
            "typical": np.full(size, chamfer_matrix(few, few).mean(axis=0).argmin()),
            "by silhouette": np.array(alike) // self.views,
            "by truth": np.broadcast_to(chamfer_matrix(asked, few).argmin(axis=1)[:, None], size),
        }
        return {how: np.array([self._looked_up(clouds, row, found[row]) for row in range(len(found))]) for how, found in chosen.items()}

    def _looked_up(self, clouds: list[NDArray[np.float64]], row: int, chosen: NDArray[np.intp]) -> list[tuple[float, float, float]]:
        """Measure the clouds that were chosen for the views of an object."""
        figures = {at: self._figures(clouds[at], row) for at in set(chosen.tolist())}
        return [figures[at] for at in chosen.tolist()]

    def _scale_of(self, object_id: str) -> float:
        """The factor to the standard's size: from the diagonal that objects were scaled to, or the object's own where it was not scaled."""
        view = self._surfaces.view(object_id)
        if "metres_per_unit" in view and view["metres_per_unit"] > 0:
            return self.settings.scale / float(length(np.ptp(read_mesh(view).vertices, axis=0)))
        return self.settings.scale / float(self.rows.attributes("surfaces")["settings"]["diagonal"])

    def _figures(self, predicted: NDArray[np.floating], row: int) -> tuple[float, float, float]:
        truth = self._points(self.rows, self.rows.object_ids[row])
        return figures_of(cloud_distances(predicted, truth), scale=self._scales[row], tau=self.settings.tau)

    def _points(self, rows: ObjectRows, object_id: str) -> NDArray[np.float64]:
        return rows.read("points", object_id)[: self.settings.points].astype(np.float64)

    def _silhouettes(self, rows: ObjectRows, object_id: str) -> NDArray[np.bool_]:
        """(view, pixel) of the views that are measured."""
        return rows.read("silhouette", object_id)[: self.views, ::STEP, ::STEP].reshape(self.views, -1)
