"""The protocols: reconstructions from grasps (supplement 2.4 and 3.5), and from single images by Table 4's standard (3.6)."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.manifest import TOTAL
from pipeline.console import abbreviate, pluralise
from pipeline.dataset.grasps import grasp_counts, grasping_sensors
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows, has_paper_sizes, is_surface
from pipeline.engine.stage import DatasetJob
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import face_cross_products, is_watertight
from pipeline.kernels.metrics.cloud_distances import CloudDistances, ring_indices, ring_means, sampled_area
from pipeline.kernels.metrics.surface_quality import (
    crossing_faces,
    dihedral_angles,
    intersection_over_union,
    normal_consistency,
    seam_gaps,
    surface_area,
)
from pipeline.kernels.touch.depth_maps import local_points
from pipeline.kernels.vision.scene import Label
from pipeline.models.reconstruction import close_reconstruction
from pipeline.rng import numpy_rng
from schemas.charts import StopRule
from stages.evaluate.baselines import retrieve
from stages.evaluate.evaluation_files import Arrays, Figures
from stages.evaluate.measure import Case, MeasuredCase, Method, Protocol
from stages.evaluate.surface_parts import SurfaceParts

NEAR, NEAR_SHARE = 5e-3, 0.01  # distances of the F-scores: m, and a share of the object's diagonal
NEARER = 2e-3  # m, where not all objects were scaled to 0.5 m
POINTS_IN_BOX = 20_000
"""Points in the box around an object and its closed mesh: their overlap is accurate to 0.02 if they fill a twentieth of the box."""
CHAMFER_FACTOR = 1000.0  # factor of Table 4's Chamfer distances
SILHOUETTE_STEP = 2  # every second pixel of every second row of a rendering's silhouette is compared


class GraspProtocol(Protocol):
    """Measure reconstructions from grasps. It reads only the images and charts that the networks take."""

    stage = "evaluate"

    def __init__(self, job: DatasetJob, methods: Sequence[Method]) -> None:
        images = sorted({item.image for item in methods if item.image is not None})
        takes_touch, charts = (any(getattr(item, name) for item in methods) for name in ("touch", "charts"))
        arrays = ["points", "normals", "sensor_pose", "touch_success", *images, *(["projection"] if images else [])]
        if takes_touch:
            arrays += ["depth", "untouched", *(["vertices", "residual", "iterations", "stop_rule"] if charts else [])]
        if has_sizes := not has_paper_sizes(job.data):
            arrays += ["segmentation"] if images else []
        super().__init__(job, arrays, ["points", "segmentation"] if images else ["points"])
        self.takes_image, self.takes_touch = bool(images), takes_touch
        self.parts = SurfaceParts(self.objects, image=bool(images), touch=takes_touch) if has_sizes else None
        self.true_area = cache(lambda name: sampled_area(self.objects.points(name), self.objects.normals(name)))  # m²
        attributes = {"grasps": self.objects.attributes("grasps")}
        self.sensors = self.objects.sensors() if takes_touch else grasping_sensors(attributes)
        self.grasps = self.objects.size("touch_success", "grasp")
        if (missing := [str(number) for number in self.settings.grasps if number > self.grasps]) and charts:
            job.console.print(
                f"evaluate.grasps: {', '.join(missing)} skipped: the dataset holds {pluralise(self.grasps, 'grasp')} of each object "
                "(simulate-grasps.grasps)"
            )
        counts = grasp_counts(self.objects.collections["grasps"], self.objects.object_ids)
        if fewer := [name for name, count in counts.items() if count < self.grasps]:
            job.console.print(
                f"warning: grasps of {pluralise(len(fewer))} that read-grasps repeated ({abbreviate(fewer)}) count again in all figures; "
                f"read-grasps.grasps={min(counts.values())} repeats none"
            )
        for item in methods:
            item.prepare(self, self.grasps)

    def cases(self, method: Method) -> list[Case]:
        return method.cases(self.grasps, self.settings.grasps)

    def identity(self, object_id: str, case: Case) -> tuple[str | int, ...]:
        """Name the draw of points by object and grasps."""
        return object_id, case.first, case.grasp_count

    def figures(self, method: Method, measured: MeasuredCase) -> Iterator[tuple[int, str, float]]:
        """Measure the distances of a case; add its appearance if it is the first, and the rings around its touches if it has one grasp."""
        settings, case = self.settings, measured.case
        distances = self.distance_figures(measured.distances, measured.object_id)
        for suffix, multiple in (("", 1.0), ("_2tau", 2.0)):
            tau = multiple * settings.tau
            precision, recall = measured.distances.precision_recall(tau, settings.scale)
            f1 = measured.distances.f1(tau, settings.scale)
            distances |= {f"precision{suffix}": precision, f"recall{suffix}": recall, f"f1{suffix}": f1}
        for first in case.firsts:
            part_figures = self.part_figures(measured.distances, measured.object_id, first)
            yield from ((first, metric, value) for metric, value in (distances | part_figures).items())
        if measured.is_first:
            appearance = self.appearance(measured) | self.closed(method, measured)
            yield from ((case.first, metric, value) for metric, value in appearance.items())
        if case.grasp_count == 1:
            yield from self.rings(measured)

    def distance_figures(self, distances: CloudDistances, object_id: str) -> dict[str, float]:
        """Compute the figures of a reconstruction that a baseline has too."""
        return {
            "mean_distance": distances.mean_distance,
            "f_5mm": distances.f1(NEAR**2),
            "f_1percent": distances.f1((NEAR_SHARE * self.objects.diagonal(object_id)) ** 2),
            "chamfer": distances.chamfer,
            **({"f_2mm": distances.f1(NEARER**2)} if self.parts else {}),
        }

    def part_figures(self, distances: CloudDistances, object_id: str, first: int) -> dict[str, float]:
        """Compute the mean distances of the parts of an object's surface that have points, where not all were scaled to 0.5 m."""
        masks = self.parts.masks(object_id, first) if self.parts else {}
        return {f"{part}_distance": float(np.sqrt(distances.truth[mask]).mean()) for part, mask in masks.items() if mask.any()}

    def rings(self, measured: MeasuredCase) -> Iterator[tuple[int, str, float]]:
        """Measure the points of the object in rings around each touch of a case with one grasp."""
        points, rings = self.objects.points(measured.object_id), self.settings.rings
        touched, poses = (self.objects.read(name, measured.object_id) for name in ("touch_success", "sensor_pose"))
        for grasp in measured.case.firsts:
            for sensor in np.flatnonzero(touched[grasp]):
                ring = ring_indices(points, poses[grasp, sensor], self.sensors[sensor].width, rings)
                means, counts = ring_means(measured.distances.truth, ring, rings)
                yield from ((grasp, f"local_chamfer_{at + 1}", float(means[at])) for at in np.flatnonzero(counts))

    def appearance(self, measured: MeasuredCase) -> dict[str, float]:
        """Measure the appearance of a reconstruction; see the schema's `QUALITY`. For a point cloud, measure its farthest points alone."""
        reconstruction = measured.reconstruction
        spike = {"spike": float(np.sqrt(np.quantile(measured.distances.predicted, 0.999)))}
        if not len(reconstruction.faces):
            return spike
        vision = reconstruction.faces[(reconstruction.faces < reconstruction.vision).all(axis=1)]
        angles = dihedral_angles(reconstruction.vertices, vision)
        across = face_cross_products(reconstruction.vertices[measured.faces])
        point_normals = across / np.linalg.norm(across, axis=1, keepdims=True)  # a face with a point on it has an area
        return {
            "area_ratio": surface_area(reconstruction.vertices, reconstruction.faces) / self.true_area(measured.object_id),
            **({"dihedral": float(np.median(angles))} if len(angles) else {}),  # triangles without a common edge have none
            "seam_gap": 0.0
            if reconstruction.is_whole
            else float(seam_gaps(reconstruction.vertices[: reconstruction.vision], reconstruction.position).mean()),
            **spike,
            "normal_consistency": normal_consistency(point_normals, self.objects.normals(measured.object_id), measured.distances),
            "crossing": float(crossing_faces(reconstruction.vertices, vision, reconstruction.position).mean()),
        }

    def closed(self, method: Any, measured: MeasuredCase) -> dict[str, float]:
        """Measure the overlap of the insides of the object and a reconstruction, closed if the settings ask for it.

        The figures are `watertight` (0 or 1) and, if the object's mesh is watertight, `iou`, which is 0 of an open
        surface: else a method would seem better if it left hard objects open. There are none for charts that are not to
        be closed. Surfaces so thin that no point is inside have no `iou`.
        """
        object_id, reconstruction = measured.object_id, measured.reconstruction
        if self.settings.closed_resolution:
            observation = method.observe(self.objects, object_id, measured.case)
            vertices, faces = close_reconstruction(reconstruction, self.settings.closed_resolution, observation)
        elif reconstruction.is_whole and len(reconstruction.faces):
            vertices, faces = reconstruction.vertices, reconstruction.faces
        else:
            return {}
        closed = {"watertight": float(is_watertight(faces))}
        if not bool(self.objects.surface(object_id)["watertight"]):
            return closed
        if not closed["watertight"]:
            return closed | {"iou": 0.0}
        mesh = read_mesh(self.objects.surface(object_id))
        (low, high), (true_low, true_high) = ((surface.min(axis=0), surface.max(axis=0)) for surface in (vertices, mesh.vertices))
        if (low > true_high).any() or (true_low > high).any():  # points in a box around both may all miss surfaces that are far apart
            return closed | {"iou": 0.0}
        rng = numpy_rng(self.job.seed, "evaluate", "closed", object_id)
        points = rng.uniform(np.minimum(low, true_low), np.maximum(high, true_high), (POINTS_IN_BOX, 3))
        with suppress(InvalidInput):  # both are thinner than the spacing of the points
            closed["iou"] = intersection_over_union((vertices, faces), (mesh.vertices, mesh.faces), points)
        return closed

    def baselines(self) -> dict[str, Figures]:
        if self.training is None:
            return {}
        images = ObjectRows(self.job.data, ["segmentation"], None, cache_megabytes=0) if self.takes_image else None

        def silhouettes(object_id: str) -> NDArray[np.bool_]:
            assert images is not None
            return np.asarray(images.read("segmentation", object_id, camera=0)[0] == Label.OBJECT).reshape(1, -1)

        return retrieve(
            self.objects,
            self.training,
            lambda distances, name: self.distance_figures(distances, name) | self.part_figures(distances, name, 0),
            console=self.job.console,
            silhouettes=silhouettes if images else None,
            touched=self._touched_points if self.takes_touch else None,
        )

    def _touched_points(self, object_id: str) -> NDArray[np.float64]:
        """Collect the points that the sensors touched in an object's first grasp, (N, 3), m; the sensors' positions if none touched."""
        depth, poses, touched = (self.objects.read(name, object_id, 0) for name in ("depth", "sensor_pose", "touch_success"))
        clouds = [local_points(depth[site], poses[site], self.sensors[site]) for site in np.flatnonzero(touched)]
        return np.concatenate([cloud[:count] for cloud, count in clouds] or [poses[:, :3, 3]]).astype(np.float64)

    def extra(self) -> dict[str, Arrays]:
        """Summarise the touch charts, where they were read."""
        if "residual" not in self.objects.arrays:
            return {}
        names = ("residual", "iterations", "stop_rule")
        arrays = (np.stack([self.objects.read(name, object_id) for object_id in self.objects.object_ids]) for name in names)
        return {"charts": chart_residuals(*arrays)}


def chart_residuals(
    residual: np.ndarray,  # (object, grasp, sensor) m
    iterations: np.ndarray,  # (object, grasp, sensor)
    stop_rule: np.ndarray,  # (object, grasp, sensor) numbers of `StopRule`
) -> Arrays:  # the group `charts` of the schema `evaluation`
    """Summarise the residuals of touch charts by stop rule."""
    masks_by_rule = {rule.name: stop_rule == rule for rule in StopRule if rule != StopRule.no_touch and (stop_rule == rule).any()}
    masks_by_rule[TOTAL] = is_surface(stop_rule)
    masks = masks_by_rule.values()
    return {
        "stop_rule": np.array([*masks_by_rule]),
        "charts": np.array([mask.sum() for mask in masks]),
        "residual_mean": np.array([residual[mask].mean(dtype=np.float64) if mask.any() else 0.0 for mask in masks]),
        "residual_worst": np.array([residual[mask].max(initial=0) for mask in masks]),
        "iterations": np.array([iterations[mask].mean(dtype=np.float64) if mask.any() else 0.0 for mask in masks]),
    }


class SingleImageProtocol(Protocol):
    """Measure reconstructions from renderings in the unit of Table 4."""

    stage = "evaluate-single-image"

    def __init__(self, job: DatasetJob) -> None:
        arrays = ("points", "rendering", "rendering_camera", "silhouette")
        super().__init__(job, arrays, arrays)
        self.views = min(self.settings.views, self.objects.size("rendering", "viewpoint"))

    def cases(self, method: Method) -> list[Case]:
        return [Case(view, (), 1, (view,)) for view in range(self.views)]

    def identity(self, object_id: str, case: Case) -> tuple[str | int, ...]:
        """Name the draw of points by object and view."""
        return object_id, case.first

    def figures(self, method: Method, measured: MeasuredCase) -> Iterator[tuple[int, str, float]]:
        figures = self.distance_figures(measured.distances, measured.object_id)
        yield from ((measured.case.first, metric, value) for metric, value in figures.items())

    def baselines(self) -> dict[str, Figures]:
        if self.training is None:
            return {}
        every = ObjectRows(self.job.data, ["silhouette"], None, cache_megabytes=0)

        def silhouettes(object_id: str) -> NDArray[np.bool_]:
            return every.read("silhouette", object_id)[: self.views, ::SILHOUETTE_STEP, ::SILHOUETTE_STEP].reshape(self.views, -1)

        return retrieve(self.objects, self.training, self.distance_figures, console=self.job.console, silhouettes=silhouettes)

    def distance_figures(self, distances: CloudDistances, object_id: str) -> dict[str, float]:
        """Compute the figures in the standard's unit, to which the diagonal that objects were scaled to is scaled, or the object's own."""
        if self.objects.surface(object_id)["metres_per_unit"] > 0:
            diagonal = self.objects.diagonal(object_id)
        else:
            diagonal = self.objects.attributes("surfaces")["settings"]["diagonal"]
        return table_4_figures(distances, scale=float(self.settings.scale / diagonal), tau=self.settings.tau)


def table_4_figures(
    distances: CloudDistances,  # squared, between predicted and true points, m²
    *,
    scale: float,  # from metres to the standard's unit
    tau: float,  # squared distance of F1, in that unit
) -> dict[str, float]:
    """Compute the figures of one reconstruction by Table 4's standard: Chamfer distance × `CHAMFER_FACTOR`, F1 at tau and 2 tau."""
    chamfer = CHAMFER_FACTOR * scale**2 * distances.chamfer
    return {"scaled_chamfer": chamfer, "f1": distances.f1(tau, scale), "f1_2tau": distances.f1(2 * tau, scale)}
