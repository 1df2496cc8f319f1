"""The demo: an object that no training saw is grasped once, seen once, and reconstructed by the pretrained networks."""

import time
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.drawing.views import fitted_camera
from pipeline.engine.make import make
from pipeline.errors import StageError
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh import Look, Mesh, sample_triangles
from pipeline.kernels.geometry.transforms import rotation_from_euler
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.vision.camera import Camera
from pipeline.kernels.vision.scene import Label
from pipeline.models.shipped_weights import DEFAULT, shipped_models
from pipeline.reconstruct.predict import Prediction, PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from stages.registry import DATASET, make_request
from stages.render_vision.renderer import Renderer

MANIFEST, OBJECT = "toy", "bottle-0001"  # an object of a class that the pretrained networks know, which is not in their training set
SETTINGS = ("simulate-grasps.grasps=1",)
FRAMES, PIXELS, MILLISECONDS = 36, 256, 80  # of the turntable: pictures of a turn, pixels per side of each mesh, and time per picture


class Demo(NamedTuple):
    """The results of a demo."""

    mesh: Path  # of the closed mesh
    turntable: Path  # an animation of the object beside it
    image: Path  # the image that the network was given
    prediction: Prediction
    distance: float  # mean distance between reconstruction and object, m
    seconds: float  # of the reconstruction, without the simulation and the pictures


def demo(folder: Path, console: Console) -> Demo:
    """Simulate a grasp of a bottle, reconstruct it from one image and the touches of that grasp, and draw it beside the object.

    The folder gets the mesh, the pictures and, below `data`, the simulated grasp.
    """
    models, data = shipped_models(), folder / "data"
    if other_objects := set(DataDirectory(data).collection(SURFACES)) - {OBJECT}:
        raise StageError(f"{data} holds another dataset, of {min(other_objects)} and so on; name another folder")
    for name in DATASET:
        request = make_request(name, MANIFEST, data=data, assignments=SETTINGS)
        make(replace(request, objects=[item for item in request.objects if item.object_id == OBJECT]), console)
    mesh, turntable, image_path = folder / f"{OBJECT}.glb", folder / "turntable.webp", folder / "seen.png"
    began = time.perf_counter()
    prediction = predict(mesh, StoredGrasps(data, OBJECT), PredictOptions(models, DEFAULT), "closed")
    seconds = time.perf_counter() - began
    rows = ObjectRows(data, ["occluded", "points"], None)
    Image.fromarray(rows.read("occluded", OBJECT, 0, camera=0)).save(image_path)
    closed, points = prediction.closed, rows.read("points", OBJECT)
    assert closed is not None
    look = replace(Look.plain(len(closed.vertices), len(closed.faces), (255, 255, 255)), vertex_color=closed.painted)
    reconstruction = Mesh(closed.vertices, closed.faces.astype(np.int32), look)
    draw_turntable(read_mesh(DataDirectory(data).collection(SURFACES).view(OBJECT)), reconstruction, turntable)
    drawn, _ = sample_triangles(closed.vertices[closed.faces], len(points), np.random.default_rng(0))
    return Demo(mesh, turntable, image_path, prediction, cloud_distances(drawn, points).mean_distance, seconds)


def draw_turntable(truth: Mesh, reconstruction: Mesh, path: Path) -> None:
    """Draw an object and its reconstruction side by side, once around, as an animated WebP."""
    scene = load_scene("supplement")
    with Renderer(scene, PIXELS) as renderer:
        cameras, views = _orbit(scene.camera.with_resolution(PIXELS), truth.vertices), []
        for mesh in (truth, reconstruction):
            with renderer.added(mesh, Label.OBJECT) as handle:
                views.append([renderer.render_colors([(handle, np.eye(4))], camera) for camera in cameras])
        frames = [Image.fromarray(np.concatenate(pair, axis=1)) for pair in zip(*views, strict=True)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=MILLISECONDS, loop=0, quality=80)


def _orbit(camera: Camera, points: NDArray[np.float64]) -> list[Camera]:
    """Place cameras once around the middle of points, starting from a camera, each with a view of all points."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, np.linalg.norm(high - low) / np.sqrt(12)
    corners = middle + half * np.array(list(product((-1, 1), repeat=3)))  # of a cube that is as large
    cameras = []
    for angle in np.arange(FRAMES) * 2 * np.pi / FRAMES:
        position = middle + rotation_from_euler((0, 0, angle)) @ (np.array(camera.position) - middle)
        cameras.append(fitted_camera(camera.model_copy(update={"position": tuple(position.tolist())}), corners))
    return cameras
