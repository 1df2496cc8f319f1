"""The protocol of supplement 3.6: Table 4's standard on the views of each object."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.kernels.metrics.cloud_distances import CloudDistances
from stages.evaluate.baselines import retrieve
from stages.evaluate.evaluation_files import Figures
from stages.evaluate.measure import MeasuredCase, Protocol, TestObjects, training_objects
from stages.evaluate.reconstructors import Case, Reconstructor
from stages.evaluate.stage import SingleImageEvaluationSettings

ARRAYS = ("points", "rendering", "rendering_camera", "silhouette")
STEP = 2
"""Every second pixel of every second row of a silhouette is compared."""
CHAMFER_FACTOR = 1000.0
"""Factor of Table 4's Chamfer distances."""


class SingleImageProtocol(Protocol):
    """Measure reconstructions from renderings in the unit of Table 4."""

    stage = "evaluate-single-image"

    def __init__(self, job: DatasetJob, reconstructors: Sequence[Reconstructor]) -> None:
        self.job, self.settings = job, job.settings
        settings: SingleImageEvaluationSettings = job.settings
        self.objects = TestObjects(job.data, ARRAYS, settings.points, self.stage)
        self.training = training_objects(job.data, ARRAYS)
        self.views = min(settings.views, self.objects.rows.size("rendering", "viewpoint"))
        self._scales = [self._scale_of(row) for row in range(len(self.objects))]

    def cases(self, reconstructor: Reconstructor) -> list[Case]:
        """List the views."""
        return [Case(view, (), 1, (view,)) for view in range(self.views)]

    def identity(self, object_id: str, case: Case) -> tuple[str | int, ...]:
        """Name the draw of points by object and view."""
        return object_id, case.first

    def figures(self, reconstructor: Reconstructor, measured: MeasuredCase) -> Iterator[tuple[int, str, float]]:
        """Measure the distances of a view."""
        yield from ((measured.case.first, metric, value) for metric, value in self._figures(measured.distances, measured.row).items())

    def baselines(self) -> dict[str, Figures]:
        """Measure training objects in place of reconstructions; none if every training object failed."""
        if self.training is None:
            return {}
        all_objects = ObjectRows(self.job.data, ["silhouette"], None)

        def silhouettes(object_id: str) -> NDArray[np.bool_]:
            return all_objects.read("silhouette", object_id)[: self.views, ::STEP, ::STEP].reshape(self.views, -1)

        return retrieve(self.objects, self.training, self._figures, console=self.job.console, silhouettes=silhouettes)

    def _figures(self, distances: CloudDistances, row: int) -> Mapping[str, float]:
        return figures_of(distances, scale=self._scales[row], tau=self.settings.tau)

    def _scale_of(self, row: int) -> float:
        """Compute the factor to the standard's size from the diagonal that objects were scaled to, or the object's if it was not scaled."""
        view = self.objects.surfaces.view(self.objects.rows.object_ids[row])
        if "metres_per_unit" in view and view["metres_per_unit"] > 0:
            return float(self.settings.scale / self.objects.diagonal(row))
        return float(self.settings.scale / self.objects.rows.attributes("surfaces")["settings"]["diagonal"])


def figures_of(
    distances: CloudDistances,  # squared, between predicted and true points, m²
    *,
    scale: float,  # from metres to the standard's unit
    tau: float,  # squared distance of F1, in that unit
) -> dict[str, float]:
    """Compute the figures of one reconstruction by Table 4's standard, by metric.

    They are the Chamfer distance × `CHAMFER_FACTOR` in the standard's unit, and F1 at tau and 2 tau.
    """
    chamfer = CHAMFER_FACTOR * scale**2 * distances.chamfer
    return {"scaled_chamfer": chamfer, "f1": distances.f1(tau, scale), "f1_2tau": distances.f1(2 * tau, scale)}
