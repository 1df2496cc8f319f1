"""What could be built otherwise: choices that are no setting, because one of them serves, measured all the same.

How many pixels a sensor has, what traces its rays in which precision, what draws images, and what object and hand are to physics.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import igl
import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from skimage.transform import resize

from benchmarks.grasps import independent_depth
from benchmarks.tradeoff.errors import POINTS
from benchmarks.tradeoff.tiny import tiny_renderer
from pipeline.config.scene_file import load_scene
from pipeline.config.sensor_file import load_sensor
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.face_culling import BoxedFaces, box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor, ray_origins
from pipeline.kernels.vision.labels import Label
from pipeline.rng import numpy_rng
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from stages.render_vision.renderer import Renderer
from stages.simulate_grasps.attempt import attempt
from stages.simulate_grasps.physics import simulation
from stages.simulate_grasps.rig import Rig, make_rig, make_scene
from stages.simulate_grasps.settings import GraspSettings
from tests.vision.twins import cast

PIXELS = (25, 50, 100, 200)
FINEST = 400
ATTEMPTS = 6
"""An object, with each of the shapes that physics may take it for."""
FEW_FACES = 500
RESOLUTION = 256
Depths = NDArray[np.float64]
MISSED = 1e30
"""What Embree calls a ray that hits nothing is 1e37."""


class Object:
    """A grasped object of a data set."""

    def __init__(self, surface: Any, grasps: Any) -> None:
        self.mesh = read_mesh(surface)
        self.points, self.normals = surface["points"], surface["normals"]
        self.poses: NDArray[np.float64] = grasps["sensor_pose"][grasps["touch_success"]]

    @cached_property
    def faces(self) -> BoxedFaces:
        return box_faces(self.mesh.triangles)


def alternatives(data: Path) -> list[dict[str, Any]]:
    """A row an alternative: what it is, seconds, and its figures."""
    surfaces, grasps = Collection(Layout(data), SURFACES), Collection(Layout(data), GRASPS)
    objects = [Object(surfaces.view(name), grasps.view(name)) for name in grasps]
    return [*_pixels(objects), *_tracers(objects), *_renderers(objects), *_shapes(objects)]


def _pixels(objects: list[Object]) -> Iterator[dict[str, Any]]:
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


def _tracers(objects: list[Object]) -> Iterator[dict[str, Any]]:
    """The same rays in float64, as scan conversion, and in float32, as Embree's first hits."""
    sensor = load_sensor("gel_16mm")
    exact, seconds = _timed(objects, lambda one, pose: ray_depth(one.faces, pose, sensor))
    yield _row("precision of rays", "float64 (ours)", seconds, {"worst in the gel, um": 0.0})
    scenes = {id(one): EmbreeScene() for one in objects}
    held = [TriangleMesh(scenes[id(one)], one.mesh.triangles.astype(np.float32)) for one in objects]
    rough, seconds = _timed(objects, lambda one, pose: _embree(scenes[id(one)], pose, sensor))
    del held
    worst, lost = 0.0, 0
    for theirs, ours in zip(rough, exact, strict=True):
        met, inside = theirs < MISSED, ours < sensor.w
        worst = max(worst, float(np.abs(theirs - ours)[met & inside].max(initial=0)))
        lost += int((inside & ~met).sum())
    yield _row("precision of rays", "float32 (Embree)", seconds, {"worst in the gel, um": 1e6 * worst, "hits lost": lost})


def _embree(scene: EmbreeScene, pose: NDArray[np.float64], sensor: Sensor) -> NDArray[np.float64]:
    origins = ray_origins(pose, sensor).reshape(-1, 3).astype(np.float32)
    found = scene.run(origins, np.tile(pose[:3, 2].astype(np.float32), (len(origins), 1)), query="DISTANCE")
    return np.asarray(found, np.float64).reshape(sensor.shape)


def _shapes(objects: list[Object]) -> Iterator[dict[str, Any]]:
    """Attempts at grasps where physics takes object and hand for themselves, or for something simpler or finer."""
    rig = make_rig(GraspSettings())
    shapes: dict[str, Callable[[Mesh], Mesh]] = {
        "the mesh (ours)": lambda mesh: mesh,
        f"{FEW_FACES} faces": _few,
        "convex hull": _hull,
    }
    rows = [_attempts("the object in physics", label, objects, rig, rig.hand, shape) for label, shape in shapes.items()]
    yield from rows
    yield rows[0] | {"what": "the hand in physics", "label": "the URDF's boxes (ours)"}
    with TemporaryDirectory() as place:
        drawn = replace(rig.hand, urdf=_as_drawn(rig.hand.urdf, Path(place)))
        yield _attempts("the hand in physics", "hulls of what is drawn", objects, rig, drawn, shapes["the mesh (ours)"])


def _attempts(what: str, label: str, objects: list[Object], rig: Rig, hand: Hand, shape: Callable[[Mesh], Mesh]) -> dict[str, Any]:
    """The same attempts with other shapes in physics; what touches and how deep it stands is told from the true ones."""
    settings = GraspSettings()
    touched, depths, spent = [], [], 0.0
    with simulation(hand) as physics:
        for number, one in enumerate(objects):
            scene = make_scene(one.mesh, one.points, one.normals, settings.grid_cell)
            physics.load(shape(one.mesh))
            for tried in range(ATTEMPTS):
                start = time.perf_counter()
                grasp = attempt(rig, scene, physics, settings, numpy_rng(0, "alternatives", number, tried))
                spent += time.perf_counter() - start
                touched.append(grasp.touched.mean() if grasp is not None and grasp.sound else 0.0)
                if grasp is not None and grasp.sound:
                    depths.append(independent_depth(rig, one.mesh, grasp, numpy_rng(0, "depth", number, tried), POINTS))
    figures = {
        "touches missing or unsound, %": 100 * (1 - float(np.mean(touched))),
        "deepest of the sound, mm": 1e3 * max(depths, default=0.0),
    }
    return _row(what, label, spent / (ATTEMPTS * len(objects)), figures)


def _as_drawn(urdf: Path, place: Path) -> Path:
    """A URDF whose links collide as the convex hulls of what is drawn of them; gels, which are soft, do not collide."""
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


def _renderers(objects: list[Object]) -> Iterator[dict[str, Any]]:
    """Silhouettes of the objects against rays through the pixels' centres."""
    scene = load_scene("supplement")
    camera = scene.camera.with_resolution(RESOLUTION)
    truth = [cast(camera, one.mesh) == Label.OBJECT for one in objects]
    with Renderer(scene, RESOLUTION) as ours, tiny_renderer(camera) as theirs:
        ways = {"pyrender (ours)": partial(_drawn, ours), "PyBullet's TinyRenderer": theirs}
        for label, draw in ways.items():
            draw(objects[0].mesh)  # what is compiled once is in no time
            start = time.perf_counter()
            masks = [draw(one.mesh) for one in objects]
            seconds = (time.perf_counter() - start) / len(objects)
            wrong = [100 * (mask != true).sum() / true.sum() for mask, true in zip(masks, truth, strict=True)]
            yield _row("the renderer, 256 x 256", label, seconds, {"silhouette wrong, % of it": float(np.mean(wrong))})


def _drawn(renderer: Renderer, mesh: Mesh) -> NDArray[np.bool_]:
    part = renderer.add(mesh, Label.OBJECT)
    view = renderer.render([(part, np.eye(4))])
    renderer.remove(part)
    mask: NDArray[np.bool_] = view.segmentation == Label.OBJECT
    return mask


def _few(mesh: Mesh) -> Mesh:
    if len(mesh.faces) <= FEW_FACES:
        return mesh
    vertices, faces, *_ = igl.decimate(mesh.vertices, mesh.faces.astype(np.int64), FEW_FACES, True)
    return Mesh.bare(vertices, faces) if len(faces) else mesh


def _hull(mesh: Mesh) -> Mesh:
    hull = trimesh.convex.convex_hull(mesh.vertices)
    return Mesh.bare(hull.vertices, hull.faces)


def _timed(
    objects: list[Object], trace: Callable[[Object, NDArray[np.float64]], NDArray[np.float64]]
) -> tuple[list[NDArray[np.float64]], float]:
    """What is traced of every touch, and the mean seconds of one."""
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
