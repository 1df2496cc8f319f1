"""One model on the objects of a split: reconstruct each case once, and measure it by a protocol."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError
from pipeline.kernels.geometry.mesh import sample_triangles
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances
from pipeline.models.observation import Observation, stored_observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor
from pipeline.rng import numpy_rng
from stages.evaluate.evaluation_files import Arrays, Figure, Figures
from stages.evaluate.ground_truth import TestObjects


@dataclass(frozen=True)
class Case:
    """Choose grasps, or a view, the same for every object.

    Attributes
    ----------
    first
        The first grasp; the occluded image is the one with the hand in it. Or the view.
    grasps
        The grasps whose touches are given, none for a model without touch.
    given
        Number of grasps that the figures are of.
    firsts
        The first grasps whose figures the reconstruction gives.
    """

    first: int
    grasps: tuple[int, ...]
    given: int
    firsts: tuple[int, ...]


@dataclass(frozen=True)
class Measured:
    """A reconstruction of an object (`row`) in a case, with points drawn from it and their faces, and its distances to the object.

    `is_first` tells whether it is the first case of its object.
    """

    row: int
    case: Case
    made: Reconstruction
    sampled: NDArray[np.float64]
    faces: NDArray[np.int64]
    apart: CloudDistances
    is_first: bool


class Protocol(ABC):
    """What is measured of reconstructions, and what models are shown.

    Attributes
    ----------
    stage
        The stage that measures by it.
    objects
        The test objects.
    """

    stage: ClassVar[str]
    keeps_surfaces: ClassVar[bool] = False
    objects: TestObjects

    @abstractmethod
    def cases(self, model: Reconstructor) -> list[Case]:
        """List the cases of a model."""

    @abstractmethod
    def identity(self, name: str, object_id: str, case: Case) -> tuple[str | int, ...]:
        """Name the draw of points from a reconstruction."""

    @abstractmethod
    def figures(self, name: str, model: Reconstructor, one: Measured) -> Iterator[tuple[int, str, float]]:
        """Measure a reconstruction: the first grasp or view that a figure is of, its metric and its value."""

    @abstractmethod
    def baselines(self) -> dict[str, Figures]:
        """Measure training objects in place of reconstructions, by how they are chosen."""

    @abstractmethod
    def extra(self, models: Sequence[Reconstructor]) -> dict[str, Arrays]:
        """Make further groups of the schema."""

    def observe(self, model: Reconstructor, row: int, case: Case) -> Observation:
        """Read what a model is shown of an object."""
        return stored_observation(self.objects.rows, self.objects.rows.object_ids[row], case.grasps or (case.first,), model.config)


def measure(name: str, model: Reconstructor, protocol: Protocol, job: DatasetJob) -> tuple[list[Figure], Arrays]:
    """Measure the model called `name`.

    Returns
    -------
    Its figures, and its group below `predictions` or `meshes`; empty where the protocol keeps no surfaces.

    Raises
    ------
    StageError
        A reconstruction is not finite.
    """
    objects, cases, size = protocol.objects, protocol.cases(model), job.settings.batch_size
    kept_cases = cases if model.has_charts else [case for case in cases if case.first == 0]  # meshes are larger
    rows: list[Figure] = []
    kept: list[Reconstruction] = []
    work = [(row, case) for row in range(len(objects)) for case in cases]
    with Meter(job.console, f"{protocol.stage} {name}", len(work), "reconstructions") as meter:
        for start in range(0, len(work), size):
            batch = work[start : start + size]
            surfaces = model.reconstruct([protocol.observe(model, row, case) for row, case in batch])
            for (row, case), made in zip(batch, surfaces, strict=True):
                object_id = objects.rows.object_ids[row]
                identity = protocol.identity(name, object_id, case)
                if not np.isfinite(made.vertices).all():
                    what = " ".join(map(str, identity))
                    raise StageError(f"the reconstruction of {what} holds NaN or infinity; was the model trained to the end?")
                rng = numpy_rng(job.seed, protocol.stage, *identity)
                sampled, face = sample_triangles(made.vertices[made.faces], objects.count, rng)
                apart = cloud_distances(sampled, objects.points(row))
                one = Measured(row, case, made, sampled, made.faces[face], apart, is_first=case is cases[0])
                rows += [Figure(object_id, first, case.given, metric, value) for first, metric, value in protocol.figures(name, model, one)]
                if protocol.keeps_surfaces and case in kept_cases:
                    kept.append(made)
                meter.advance()
    if not kept:
        return rows, {}
    surfaces_of = _charts if model.has_charts else _meshes
    return rows, {
        "object_id": np.array(objects.rows.object_ids),
        "first_grasp": np.array([case.first for case in kept_cases]),
        "grasps_given": np.array([len(case.grasps) for case in kept_cases]),
        **surfaces_of(kept, (len(objects), len(kept_cases))),
    }


def surfaces_group(model: Reconstructor) -> str:
    """Name the group below which a model's surfaces are."""
    return "predictions" if model.has_charts else "meshes"


def _charts(kept: Sequence[Reconstruction], shape: tuple[int, int]) -> Mapping[str, np.ndarray]:
    made = kept[-1]
    vertices = np.array([one.vertices[: one.vision] for one in kept], np.float32)
    faces = made.faces[(made.faces < made.vision).all(axis=1)]
    return {"vertices": vertices.reshape(*shape, -1, 3), "faces": faces, "position": made.position}


def _meshes(kept: Sequence[Reconstruction], shape: tuple[int, int]) -> Mapping[str, np.ndarray]:
    return {
        "vertices": np.concatenate([one.vertices for one in kept]),
        "faces": np.concatenate([one.faces for one in kept]),
        "vertex_count": np.reshape([len(one.vertices) for one in kept], shape),
        "face_count": np.reshape([len(one.faces) for one in kept], shape),
    }
