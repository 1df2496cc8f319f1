"""Reconstructions as closed meshes: whether they are watertight, and how much of an object's inside they share."""

from __future__ import annotations

import numpy as np

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import DatasetJob
from pipeline.kernels.geometry.mesh import is_watertight
from pipeline.kernels.metrics.surface_quality import intersection_over_union
from pipeline.models.closed_reconstruction import closed
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Reconstruction
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import Arrays
from stages.evaluate.ground_truth import Truth

POINTS = 20_000
"""In the box around an object and its reconstruction: their shared part is right to 0.02, where they fill a twentieth of it."""


class ClosedSurfaces:
    """Close one model's reconstructions, and compare them with the objects.

    Attributes
    ----------
    values
        The group `closed` of the schema, its figures 0 until an object is noted.
    """

    def __init__(self, name: str, truth: Truth, job: DatasetJob, resolution: int) -> None:
        self._name, self._seed, self._resolution = name, job.seed, resolution
        self._surfaces = DataDirectory(job.data).collection(SURFACES)
        ids, zeros = truth.rows.object_ids, np.zeros(len(truth))
        self.values: Arrays = {
            "object_id": np.array(ids),
            "watertight": zeros.astype(bool),
            "has_inside": np.array([bool(self._surfaces.view(object_id)["watertight"]) for object_id in ids]),
            "iou": zeros,
        }

    def note(self, row: int, made: Reconstruction, given: Observation) -> None:
        """Close the reconstruction of an object from what was given of it, and note its figures."""
        vertices, faces = closed(made, self._resolution, given)
        self.values["watertight"][row] = is_watertight(faces)
        if self.values["has_inside"][row]:
            object_id = str(self.values["object_id"][row])
            mesh = read_mesh(self._surfaces.view(object_id))
            corners = np.concatenate([vertices, mesh.vertices])
            rng = numpy_rng(self._seed, "evaluate", "closed", self._name, object_id)
            points = rng.uniform(corners.min(axis=0), corners.max(axis=0), (POINTS, 3))
            self.values["iou"][row] = intersection_over_union((vertices, faces), (mesh.vertices, mesh.faces), points)
