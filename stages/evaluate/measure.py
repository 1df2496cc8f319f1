"""One model on the objects of a split: reconstruct each case once, and measure it against S^obj."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances
from pipeline.kernels.metrics.surface_quality import crossing_faces, dihedral_angles, normal_consistency, seam_gaps, surface_area
from pipeline.kernels.metrics.touch_site_rings import ring_means, ring_of
from pipeline.models.reconstruction import Reconstruction, Reconstructor
from pipeline.rng import numpy_rng
from pipeline.store.spec import numpy_dtype
from schemas.evaluation import TABLES
from stages.evaluate.closed_surfaces import ClosedSurfaces
from stages.evaluate.evaluation_files import Arrays
from stages.evaluate.ground_truth import Truth
from stages.evaluate.reconstruction_cases import Case, make_cases
from stages.evaluate.settings import EvaluationSettings

THRESHOLDS = (1.0, 2.0)
"""F1 is measured at tau and at twice tau (Table 4)."""


def measure(name: str, model: Reconstructor, truth: Truth, job: DatasetJob) -> dict[str, Arrays]:
    """Measure the model called `name`: its groups below `values`, `predictions` or `meshes`, and `closed` (see the schema)."""
    settings: EvaluationSettings = job.settings
    numbers, cases = cases_of(model, truth.grasps, settings)
    values = _room(truth, numbers, settings.rings)
    kept: list[Reconstruction] = []
    kept_cases = cases if model.has_charts else [case for case in cases if case.first == 0]  # meshes are larger
    closing = ClosedSurfaces(name, truth, job, settings.closed_resolution) if settings.closed_resolution else None
    with Meter(job.console, f"evaluate {name}", len(truth), "objects") as meter:
        for row, case, made in _reconstructions(model, truth, cases, settings.batch_size):
            identity = (truth.rows.object_ids[row], name, case.first, len(case.grasps))
            if not np.isfinite(made.vertices).all():
                what = " ".join(map(str, identity))
                raise StageError(f"the reconstruction of {what} holds NaN or infinity; was the model trained to the end?")
            sampled, face = sample_triangles(made.vertices[made.faces], truth.count, numpy_rng(job.seed, "evaluate", *identity))
            apart = cloud_distances(sampled, truth.points(row))
            _note(values, row, case, apart, settings)
            if case is cases[0]:
                for key, value in quality_of(made, sampled, made.faces[face], apart, truth, row).items():
                    values[key][row] = value
                if closing:
                    closing.note(row, made, truth.view(model, row, case))
            if numbers[case.given] == 1:
                _note_rings(values, row, case, apart, truth)
            if case in kept_cases:
                kept.append(made)
            if case is cases[-1]:
                meter.advance()
    surfaces = {
        "object_id": values["object_id"],
        "first_grasp": np.array([case.first for case in kept_cases]),
        "grasps_given": np.array([len(case.grasps) for case in kept_cases]),
        **(_charts if model.has_charts else _meshes)(kept, (len(truth), len(kept_cases))),
    }
    groups = {f"values/{name}": values, f"{surfaces_group(model)}/{name}": surfaces}
    return groups | ({f"closed/{name}": closing.values} if closing else {})


def surfaces_group(model: Reconstructor) -> str:
    """Name the group below which a model's surfaces are."""
    return "predictions" if model.has_charts else "meshes"


def _charts(kept: Sequence[Reconstruction], shape: tuple[int, int]) -> Arrays:
    made = kept[-1]
    vertices = np.array([one.vertices[: one.vision] for one in kept], np.float32)
    faces = made.faces[(made.faces < made.vision).all(axis=1)]
    return {"vertices": vertices.reshape(*shape, -1, 3), "faces": faces, "position": made.position}


def _meshes(kept: Sequence[Reconstruction], shape: tuple[int, int]) -> Arrays:
    return {
        "vertices": np.concatenate([one.vertices for one in kept]),
        "faces": np.concatenate([one.faces for one in kept]),
        "vertex_count": np.reshape([len(one.vertices) for one in kept], shape),
        "face_count": np.reshape([len(one.faces) for one in kept], shape),
    }


def cases_of(model: Reconstructor, available: int, settings: EvaluationSettings) -> tuple[list[int], list[Case]]:
    """List the numbers of grasps that a model is evaluated with, of `available` ones per object, and its cases of each object."""
    numbers = [number for number in settings.grasps if number <= available] if model.touch else [1]
    return numbers, make_cases(available, numbers, touch=model.touch, occluded=model.image == "occluded")


def _reconstructions(
    model: Reconstructor, truth: Truth, cases: Sequence[Case], batch_size: int
) -> Iterator[tuple[int, Case, Reconstruction]]:
    """Reconstruct every case of every object, a batch at a time: its row, the case, and what came out."""
    work = [(row, case) for row in range(len(truth)) for case in cases]
    for start in range(0, len(work), batch_size):
        batch = work[start : start + batch_size]
        made = model.reconstruct([truth.view(model, row, case) for row, case in batch])
        yield from ((row, case, one) for (row, case), one in zip(batch, made, strict=True))


def quality_of(
    made: Reconstruction, sampled: NDArray[np.float64], faces: NDArray[np.int64], apart: CloudDistances, truth: Truth, row: int
) -> dict[str, float]:
    """Measure how a reconstruction looks, from points drawn from it and the faces they are on; see the schema's `QUALITY`."""
    vision = made.faces[(made.faces < made.vision).all(axis=1)]
    a, b, c = np.moveaxis(made.vertices[faces], 1, 0)
    across = np.cross(b - a, c - a)
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)  # a face with a point on it has an area
    return {
        "area_ratio": surface_area(made.vertices, made.faces) / truth.area_of_all_sides(row),
        "dihedral": float(np.median(dihedral_angles(made.vertices, vision))),
        "seam_gap": 0.0 if made.is_whole else float(seam_gaps(made.vertices[: made.vision], made.position).mean()),
        "spike": float(np.sqrt(np.quantile(apart.predicted, 0.999))),
        "normal_consistency": normal_consistency(sampled, normals, truth.points(row), truth.normals(row)),
        "crossing": float(crossing_faces(made.vertices, vision, made.position).mean()),
    }


def _room(truth: Truth, numbers: list[int], rings: int) -> Arrays:
    """Make the group `values`, its figures still 0."""
    dims = ("object", "first_grasp", "sensor", "grasps_given", "ring", "threshold")
    sizes = dict(zip(dims, (*truth.touched.shape, len(numbers), rings, len(THRESHOLDS)), strict=True))
    declared = TABLES["values"].arrays
    labels = {"object_id": truth.rows.object_ids, "category": truth.rows.categories, "grasps_given": numbers, "ring": range(1, rings + 1)}
    figures = {name: np.zeros([sizes[dim] for dim in array.dims], numpy_dtype(array)) for name, array in declared.items()}
    return figures | {name: np.array(label) for name, label in labels.items()}


def _note(values: Arrays, row: int, case: Case, apart: CloudDistances, settings: EvaluationSettings) -> None:
    at = (row, list(case.firsts), case.given)
    values["chamfer"][at] = apart.chamfer
    for threshold, multiple in enumerate(THRESHOLDS):
        tau = multiple * settings.tau
        values["precision"][(*at, threshold)], values["recall"][(*at, threshold)] = apart.precision_recall(tau, settings.scale)
        values["f1"][(*at, threshold)] = apart.f1(tau, settings.scale)


def _note_rings(values: Arrays, row: int, case: Case, apart: CloudDistances, truth: Truth) -> None:
    points, rings = truth.points(row), len(values["ring"])
    for grasp in case.firsts:
        for sensor in np.flatnonzero(truth.touched[row, grasp]):
            at = (row, grasp, sensor)
            ring = ring_of(points, truth.poses[at], truth.width, rings)
            values["local_chamfer"][at], values["local_points"][at] = ring_means(apart.truth, ring, rings)
