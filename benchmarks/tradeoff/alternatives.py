"""Measure choices that are no setting: the pixels of a sensor, and what object and hand are to physics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.transform import resize

from benchmarks.stored_grasps import independent_depth
from benchmarks.tradeoff.errors import POINTS
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.face_culling import BoxedFaces, box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from stages.simulate_grasps.grasp_search import GraspSearch
from stages.simulate_grasps.physics import Simulation
from stages.simulate_grasps.prepare import PreparedHand, prepare_hand, prepare_object
from stages.simulate_grasps.settings import GraspSettings

PIXELS = (25, 50, 100, 200)
FINEST = 400
ATTEMPTS = 6
"""Per object and shape."""
FEW_FACES = 500


class GraspedObject:
    """A grasped object of a dataset."""

    def __init__(self, surface: Any, grasps: Any) -> None:
        self.mesh = read_mesh(surface)
        self.points, self.normals = surface["points"], surface["normals"]
        self.poses: NDArray[np.float64] = grasps["sensor_pose"][grasps["touch_success"]]

    @cached_property
    def faces(self) -> BoxedFaces:
        return box_faces(self.mesh.triangles)


def alternatives(data: Path) -> list[dict[str, Any]]:
    """Measure every alternative: one row each, with seconds and figures."""
    surfaces, grasps = DataDirectory(data).collection(SURFACES), DataDirectory(data).collection(GRASPS)
    objects = [GraspedObject(surfaces.view(name), grasps.view(name)) for name in grasps]
    return [*_pixels(objects), *_shapes(objects)]


def _pixels(objects: list[GraspedObject]) -> Iterator[dict[str, Any]]:
    """Depth maps with fewer or more pixels, enlarged to the finest and compared where both see the gel's contents."""
    sensor = load_sensor("gel_16mm")
    fine = sensor.model_copy(update={"rows": FINEST, "cols": FINEST})
    truth = [ray_depth(one.faces, pose, fine) for one in objects for pose in one.poses]
    for pixels in PIXELS:
        coarse = sensor.model_copy(update={"rows": pixels, "cols": pixels})
        depths, seconds = _timed(objects, lambda one, pose, coarse=coarse: ray_depth(one.faces, pose, coarse))
        squares = []
        for depth, exact in zip(depths, truth, strict=True):
            ours = resize(np.minimum(depth, sensor.w), exact.shape, order=1, mode="edge")
            squares.append(np.mean((ours - np.minimum(exact, sensor.w))[exact < sensor.w] ** 2))
        yield _row(
            "pixels of a sensor", f"{pixels} x {pixels}", seconds, {"depth in the gel RMS, um": 1e6 * float(np.sqrt(np.mean(squares)))}
        )


def _shapes(objects: list[GraspedObject]) -> Iterator[dict[str, Any]]:
    """Attempt grasps where physics takes object and hand for themselves, or for something simpler or finer."""
    prepared = prepare_hand(GraspSettings())
    shapes: dict[str, Callable[[Mesh], Mesh]] = {
        "the mesh (ours)": lambda mesh: mesh,
        f"{FEW_FACES} faces": _few,
        "convex hull": _hull,
    }
    rows = [_attempts("the object in physics", label, objects, prepared, prepared.hand, shape) for label, shape in shapes.items()]
    yield from rows
    yield rows[0] | {"what": "the hand in physics", "label": "the URDF's boxes (ours)"}
    with TemporaryDirectory() as place:
        drawn = replace(prepared.hand, urdf=_as_drawn(prepared.hand.urdf, Path(place)))
        yield _attempts("the hand in physics", "hulls of what is drawn", objects, prepared, drawn, shapes["the mesh (ours)"])


def _attempts(
    what: str, label: str, objects: list[GraspedObject], prepared: PreparedHand, hand: Hand, shape: Callable[[Mesh], Mesh]
) -> dict[str, Any]:
    """Make the same attempts with other shapes in physics; touches and depth are measured on the true ones."""
    settings = GraspSettings()
    touched, depths, spent = [], [], 0.0
    with Simulation(hand) as physics:
        for number, one in enumerate(objects):
            prepared_object = prepare_object(one.mesh, one.points, one.normals, cell=settings.grid_cell)
            search = GraspSearch(prepared, prepared_object, physics, settings)
            physics.load(shape(one.mesh))
            for tried in range(ATTEMPTS):
                start = time.perf_counter()
                grasp = search.attempt(numpy_rng(0, "alternatives", number, tried))
                spent += time.perf_counter() - start
                touched.append(grasp.touched.mean() if grasp is not None and grasp.sound else 0.0)
                if grasp is not None and grasp.sound:
                    depths.append(independent_depth(prepared, one.mesh, grasp, numpy_rng(0, "depth", number, tried), POINTS))
    figures = {
        "touches missing or unsound, %": 100 * (1 - float(np.mean(touched))),
        "deepest of the sound, mm": 1e3 * max(depths, default=0.0),
    }
    return _row(what, label, spent / (ATTEMPTS * len(objects)), figures)


def _as_drawn(urdf: Path, place: Path) -> Path:
    """Write a URDF whose links collide as the convex hulls of what is drawn of them; gels, which are soft, do not collide."""
    tree = ElementTree.parse(urdf)
    for link in tree.iter("link"):
        for box in link.findall("collision"):
            link.remove(box)
        for visual in link.findall("visual"):
            material = visual.find("material")
            if material is None or material.get("name") != "gel":
                rigid = ElementTree.SubElement(link, "collision")
                rigid.extend(part for part in visual if part.tag != "material")
    for mesh in tree.iter("mesh"):
        mesh.set("filename", str(urdf.parent / str(mesh.get("filename"))))
    tree.write(place / urdf.name)
    return place / urdf.name


def _few(mesh: Mesh) -> Mesh:
    if len(mesh.faces) <= FEW_FACES:
        return mesh
    vertices, faces, *_ = igl.decimate(mesh.vertices, mesh.faces.astype(np.int64), FEW_FACES, True)
    return Mesh.bare(vertices, faces) if len(faces) else mesh


def _hull(mesh: Mesh) -> Mesh:
    hull = trimesh.convex.convex_hull(mesh.vertices)
    return Mesh.bare(hull.vertices, hull.faces)


def _timed(
    objects: list[GraspedObject], trace: Callable[[GraspedObject, NDArray[np.float64]], NDArray[np.float64]]
) -> tuple[list[NDArray[np.float64]], float]:
    """Trace every touch; the depth maps, and mean seconds per map."""
    found = []
    for one in objects:
        _ = one.faces
    start = time.perf_counter()
    for one in objects:
        found += [trace(one, pose) for pose in one.poses]
    return found, (time.perf_counter() - start) / len(found)


def _row(what: str, label: str, seconds: float, figures: dict[str, float]) -> dict[str, Any]:
    return {
        "what": what,
        "label": label,
        "seconds": float(f"{seconds:.4g}"),
        "figures": {name: float(f"{x:.4g}") for name, x in figures.items()},
    }
