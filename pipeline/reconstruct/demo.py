"""The demo: a held object that no training saw is seen and touched once, and reconstructed by a pretrained network."""

import time
from dataclasses import replace
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
from pipeline.models.families import trained_folder
from pipeline.models.shipped_weights import shipped_models
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from stages.registry import DATASET, make_request
from stages.render_vision.renderer import Renderer

MANIFEST, OBJECT = "hand-sized", "can-0121"
"""Of the bottles, cans and mugs in its test split, that whose diagonal is nearest to 10 cm; its error is near the median of all."""
SETTINGS = (
    "simulate-grasps.hand=allegro_right_mini",
    "simulate-grasps.search=hold",
    "simulate-grasps.grasps=1",
    "render-vision.scene=robot",
    "render-vision.resolution=192",
)
NETWORK = "implicit-gels"
FRAMES, PIXELS, MILLISECONDS = 36, 256, 80  # of the turntable: pictures of a turn, pixels per side of each mesh, and time per picture


class Reconstructed(NamedTuple):
    """A reconstruction of the object."""

    file: Path  # of the closed mesh
    mesh: Mesh  # coloured where the image shows it
    distance: float  # mean distance from the object, m
    seconds: float  # without the simulation and the pictures


class Demo(NamedTuple):
    """The results of a demo."""

    data: Path  # the data directory of the object and its grasp
    truth: Mesh
    image: Path  # the image that the network was given
    felt: Path  # the tactile images of the fingers, side by side
    touches: int  # fingers that touched
    from_image: Reconstructed  # from the image alone
    from_touch: Reconstructed  # from image and touch
    turntable: Path  # an animation of the object beside the reconstruction from image and touch


def demo(folder: Path, console: Console) -> Demo:
    """Simulate a grasp that holds an object, and reconstruct the object from one image, without and with touch.

    The folder gets the meshes, the pictures, a turntable of the object beside the reconstruction with touch, and, below `data`, the
    simulated grasp.
    """
    data = folder / "data"
    if other_objects := set(DataDirectory(data).collection(SURFACES)) - {OBJECT}:
        raise StageError(f"{data} holds another dataset, of {min(other_objects)} and so on; name another folder")
    trained_folder(shipped_models(), NETWORK)  # an error now, not after the simulation, if it is missing
    for name in DATASET:
        request = make_request(name, MANIFEST, data=data, assignments=SETTINGS)
        make(replace(request, objects=[item for item in request.objects if item.object_id == OBJECT]), console)
    rows = ObjectRows(data, ["occluded", "tactile_image", "touch_success"], None)
    image, felt, turntable = (folder / name for name in ("seen.png", "felt.png", "turntable.webp"))
    Image.fromarray(rows.read("occluded", OBJECT, 0, camera=0)).save(image)
    Image.fromarray(np.concatenate(rows.read("tactile_image", OBJECT, 0), axis=1)).save(felt)
    from_image = _reconstructed(folder / f"{OBJECT}-from-image.glb", data, "occluded")
    from_touch = _reconstructed(folder / f"{OBJECT}.glb", data, "occluded-touch")
    truth = read_mesh(DataDirectory(data).collection(SURFACES).view(OBJECT))
    draw_turntable(truth, from_touch.mesh, turntable)
    touches = int(rows.read("touch_success", OBJECT, 0).sum())
    return Demo(data, truth, image, felt, touches, from_image, from_touch, turntable)


def _reconstructed(file: Path, data: Path, inputs: str) -> Reconstructed:
    """Reconstruct the object from these inputs, a key of `INPUT_CHOICES`, and measure the distance."""
    began = time.perf_counter()
    closed = predict(file, StoredGrasps(data, OBJECT, inputs=inputs), PredictOptions(shipped_models(), NETWORK), "closed").closed
    seconds = time.perf_counter() - began
    assert closed is not None
    look = replace(Look.plain(len(closed.vertices), len(closed.faces), (255, 255, 255)), vertex_color=closed.painted)
    points = ObjectRows(data, ["points"], None).read("points", OBJECT)
    drawn, _ = sample_triangles(closed.vertices[closed.faces], len(points), np.random.default_rng(0))
    mesh = Mesh(closed.vertices, closed.faces.astype(np.int32), look)
    return Reconstructed(file, mesh, cloud_distances(drawn, points).mean_distance, seconds)


def draw_turntable(truth: Mesh, reconstruction: Mesh, path: Path) -> None:
    """Draw an object and its reconstruction side by side, once around, as an animated WebP."""
    scene = load_scene("supplement")
    with Renderer(scene, PIXELS) as renderer:
        points, views = np.vstack([truth.vertices, reconstruction.vertices]), []
        cameras = _orbit(scene.camera.with_resolution(PIXELS), points)
        for mesh in (truth, reconstruction):
            with renderer.added(mesh, Label.OBJECT) as handle:
                views.append([renderer.render_colors([(handle, np.eye(4))], camera) for camera in cameras])
        frames = [Image.fromarray(np.concatenate(pair, axis=1)) for pair in zip(*views, strict=True)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=MILLISECONDS, loop=0, quality=80)


def _orbit(
    camera: Camera,
    points: NDArray[np.float64],  # (N, 3) m
) -> list[Camera]:
    """Place cameras once around the middle of points, starting from a camera, each with a view of the cylinder that holds them."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, (depth, width, height) = (low + high) / 2, high - low
    turns = [rotation_from_euler((0, 0, angle)) for angle in np.arange(FRAMES) * 2 * np.pi / FRAMES]
    cylinder = [turn @ (np.hypot(depth, width) / 2, 0, z) for turn in turns for z in (-height / 2, height / 2)]
    cameras = []
    for turn in turns:
        position = middle + turn @ (np.array(camera.position) - middle)
        cameras.append(fitted_camera(camera.model_copy(update={"position": tuple(position.tolist())}), middle + np.array(cylinder)))
    return cameras
