"""`render-vision`: an image of every object alone and one of every grasp (supplement 1.4)."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pipeline.config.settings import ObjectSettings, defining, described_by, setting
from pipeline.console import abbreviate, pluralise
from pipeline.dataset.grasps import check_hand_exists
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import paired_rows
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Trade, Unit
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.hand_file import load_hand
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, POSITION, bounding_diagonal
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.vision.camera import Camera, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import Label, Scene
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.render_vision.renderer import PosedMesh, Renderer, shader_paths

SPECK = 0.1  # share of an image's side below which an object has too few pixels: 25 of 256


class VisionSettings(ObjectSettings):
    """How objects and grasps become images (supplement 1.4)."""

    scene: Annotated[str, described_by("scene")] = defining(
        "supplement", "the supplement's camera, one lamp, constant light; a built-in scene, or path of a .yaml file"
    )
    hand: Annotated[str, described_by("hand")] | None = defining(None, "null: the hand that made the grasps")
    zoom: float | None = defining(
        None,
        "factor of the focal lengths of the scene's cameras; null shows each object as large as one of 0.5 m: 5 for an object of 0.1 m",
        ge=0.01,
        le=10_000,
    )
    resolution: int = setting(256, "pixels per side, the supplement's; the camera's intrinsics scale with it", ge=16, le=4096)
    occluded: bool = defining(True, "one image per grasp; false: only the object alone, a sixth of time and bytes")


def leaves_image(camera: Camera, points: np.ndarray) -> bool:
    """Check whether any of the points (N, 3), world frame, m, is outside a camera's image."""
    rows, cols = camera.shape
    pixels = project_points(projection_matrix(camera), points.astype(np.float64))
    return not bool(((pixels >= 0) & (pixels <= [cols, rows])).all())  # NaN behind the camera is not


def is_speck(camera: Camera, points: np.ndarray) -> bool:
    """Check whether points (N, 3), world frame, m, span less than `SPECK` of a camera's image both ways."""
    rows, cols = camera.shape
    spans = np.ptp(project_points(projection_matrix(camera), points.astype(np.float64)), axis=0)
    return bool((spans < [SPECK * cols, SPECK * rows]).all())


def surrounds_lens(camera: Camera, points: np.ndarray) -> bool:  # (N, 3) of an object, world, m
    """Check whether an object reaches as far from its middle as the least distance that is drawn for a camera."""
    return camera.drawn is not None and camera.drawn.distance[0] < bounding_diagonal(points) / 2


IMAGE_FAULTS = {  # what may be wrong with an object in an image, and the remedy
    surrounds_lens: ("perhaps around the lens in", "raise drawn.distance"),
    leaves_image: ("not whole in", "move the camera"),
    is_speck: (f"smaller than {100 * SPECK:.0f} % of", "move the camera nearer"),
}


class RenderVision(ObjectStage):
    """Render objects, alone and with the hand at every grasp."""

    name = "render-vision"
    summary = "Images of every object alone and in every grasp, with segmentation."
    output = VISION
    settings_type = VisionSettings

    def inputs(self, settings: VisionSettings) -> tuple[Artifact, ...]:
        return (SURFACES, GRASPS)

    def assets(self, settings: VisionSettings) -> list[Path]:
        """List the files of the scene, the hand and the shaders."""
        return [description_path("scene", settings.scene), *load_hand(str(settings.hand)).files, *shader_paths()]

    def resolve_settings(self, settings: VisionSettings, attributes: Mapping[str, Mapping[str, Any]]) -> VisionSettings:
        """Choose the hand of the grasps."""
        return settings.model_copy(update={"hand": settings.hand or attributes["grasps"]["settings"]["hand"]})

    def check_inputs(self, settings: VisionSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Check that the hand to draw is the one that grasped."""
        hand = attributes["grasps"]["settings"]["hand"]
        if settings.hand == hand:
            check_hand_exists(hand, "name the file with --set render-vision.hand=PATH")
        if attributes["grasps"]["hand"]["digest"] == assets_digest(load_hand(str(settings.hand)).files):  # the files may have been moved
            return
        if hand != settings.hand:
            raise InvalidInput(f"the grasps are of hand {hand}, render-vision.hand is {settings.hand}; leave it out, or --set hand={hand}")
        raise InvalidInput(f"the files of hand {hand} have changed since the grasps were made; run simulate-grasps again")

    def describe_misfits(self, settings: VisionSettings, objects: Iterable[tuple[str, Inputs]]) -> Iterator[str]:
        """Name objects that leave an image, or are too small in it; and an invisible hand."""
        if settings.occluded and not load_hand(str(settings.hand)).visual_meshes:
            yield f"hand {settings.hand} has no visual shapes, so no image shows it: give its URDF <visual> elements"
        scene = _scene(settings)
        faulty: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
        for name, inputs in objects:
            points = inputs["surfaces"]["points"]
            cameras = _cameras(scene.cameras, settings, points)
            for has_fault, (fault, remedy) in IMAGE_FAULTS.items():
                if views := tuple(camera.name for camera in cameras if has_fault(camera, points)):
                    faulty.setdefault((fault, remedy, views), []).append(name)
        zoomed = "" if settings.zoom is None else f"leave render-vision.zoom ({settings.zoom:g}) out, or "
        for (fault, remedy, views), names in faulty.items():
            where = f"{fault} the image of camera {', '.join(views)}"
            yield f"{pluralise(len(names))} {where} ({abbreviate(names)}): {zoomed}{remedy} in a scene file ({settings.scene})"

    def constants(self, settings: VisionSettings) -> Row:
        return {"camera": np.array([camera.name for camera in _scene(settings).cameras])}

    def attributes(self, settings: VisionSettings) -> dict[str, Any]:
        """Describe the scene: its lamp, constant light and background are the project's choice, so they are stored with the data."""
        return {"scene": _scene(settings).model_dump(mode="json")}

    def cost(self, settings: VisionSettings) -> Cost:
        """Estimate six images, or one, with their segmentation, per camera."""
        images = (6 if settings.occluded else 1) * len(_scene(settings).cameras)
        pixels = (settings.resolution / 256) ** 2
        return Cost(seconds=0.05 + 0.025 * images * pixels, kilobytes=15 * images * pixels)

    @contextmanager
    def session(self, settings: VisionSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Open one renderer per worker, with the hand's meshes in it."""
        hand = load_hand(str(settings.hand))
        scene = _scene(settings)
        with Renderer(scene, settings.resolution) as renderer:
            meshes = [(link, renderer.add(mesh, Label.HAND)) for link, mesh in hand.visual_meshes]

            def process(unit: Unit, inputs: Inputs) -> Row:
                grasps = inputs["grasps"]
                frames = forward_kinematics(hand, grasps["hand_pose"], grasps["joint_angles"])  # (grasp, link, 4, 4)
                mesh = read_mesh(inputs["surfaces"])
                with renderer.added(mesh, Label.OBJECT) as handle:
                    views: list[list[PosedMesh]] = [[(handle, np.eye(4))]]
                    if settings.occluded:
                        views += [[*views[0], *((part, frame[link]) for link, part in meshes)] for frame in frames]
                    taken_from = [_cameras(_moved(scene, settings, unit, view), settings, mesh.vertices) for view in range(len(views))]
                    images = [
                        [renderer.render(view, camera) for camera in cameras] for view, cameras in zip(views, taken_from, strict=True)
                    ]
                row = {
                    "unoccluded": np.stack([image.rgb for image in images[0]]),
                    "segmentation": np.array([[image.segmentation for image in view] for view in images]),
                    "projection": np.array([[projection_matrix(camera) for camera in cameras] for cameras in taken_from]),
                }
                if settings.occluded:
                    row["occluded"] = np.array([[image.rgb for image in view] for view in images[1:]])
                if scene.depth:
                    row["camera_depth"] = np.array([[image.depth for image in view] for view in images])
                return row

            yield process


def _scene(settings: VisionSettings) -> Scene:
    """Load the scene, its cameras zoomed if the settings say how much."""
    scene, zoom = load_scene(settings.scene), settings.zoom or 1.0
    return scene.model_copy(update={"cameras": tuple(camera.zoomed(zoom) for camera in scene.cameras)})


def _moved(scene: Scene, settings: VisionSettings, unit: Unit, view: int) -> list[Camera]:
    """Move a scene's cameras to where they are in one of an object's images, if the scene draws that."""
    cameras = []
    for camera in scene.cameras:
        if camera.drawn is not None:
            position = camera.drawn.draw(unit.rng("render-vision", camera.name, view), POSITION)
            nearer = float(length(position - POSITION) / length(np.array(camera.position) - POSITION))
            camera = look_at(camera, tuple(position.tolist()), tuple(POSITION.tolist()))
            camera = camera.zoomed(nearer if settings.zoom is None else 1.0)  # an object is as large as it is from the stated position
        cameras.append(camera)
    return cameras


def _cameras(cameras: Sequence[Camera], settings: VisionSettings, vertices: np.ndarray) -> list[Camera]:
    """Zoom cameras to an object with these vertices (V, 3), world, m, if the settings do not say how much."""
    zoom = DIAGONAL / bounding_diagonal(vertices) if settings.zoom is None else 1.0
    pixels = [project_points(projection_matrix(camera), POSITION) for camera in cameras]
    zoomed = [camera.zoomed(zoom, at) for camera, at in zip(cameras, pixels, strict=True)]
    return [camera.with_resolution(settings.resolution) for camera in zoomed]


def image_differences(data: Path, reference: Path) -> dict[str, float]:
    """Compare images, enlarged to the reference's size, with it: RMS by object, levels of 255."""
    from skimage.transform import resize

    differences = {}
    for name, (image,), (truth,) in paired_rows(data, reference, "unoccluded"):
        enlarged = resize(image / 255.0, truth.shape, order=1)
        differences[name] = 255 * float(np.sqrt(np.square(enlarged - truth / 255.0).mean()))
    return differences


TRADE = Trade(
    metric="difference from an image of four times as many pixels, RMS",
    unit="levels",
    candidates=({"resolution": 64}, {"resolution": 128}, {"resolution": 192}, {"resolution": 384}),
    errors=image_differences,
    reference={"resolution": 512},
)
