"""`render-vision`: an image of every object alone and one of every grasp (supplement 1.4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import counted, few
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path, load_scene
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.vision.camera import Camera, projection_matrix
from pipeline.kernels.vision.labels import Label
from pipeline.kernels.vision.scene import Scene
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.render_vision.image_warnings import SPECK, is_speck, leaves_image
from stages.render_vision.opengl_context import shader_paths
from stages.render_vision.renderer import MeshHandle, PosedMesh, Renderer
from stages.render_vision.settings import VisionSettings

HandMeshes = list[tuple[int, MeshHandle]]
"""The hand's visual meshes, each with the number of its link."""


class RenderVision(ObjectStage):
    """Renders objects, alone and with the hand at every grasp."""

    name = "render-vision"
    summary = "Images of every object alone and in every grasp, with segmentation."
    output = VISION
    settings_type = VisionSettings

    def inputs(self, settings: VisionSettings) -> tuple[Artifact, ...]:
        """The meshes and the poses of the hand."""
        return (SURFACES, GRASPS)

    def assets(self, settings: VisionSettings) -> list[Path]:
        """The files of the scene, the hand and the shaders."""
        return [description_path("scene", settings.scene), *load_hand(settings.hand).files, *shader_paths()]

    def resolve_settings(self, settings: VisionSettings, attributes: Mapping[str, Mapping[str, Any]]) -> VisionSettings:
        """The hand is that of the grasps."""
        return settings.model_copy(update={"hand": settings.hand or attributes["grasps"]["settings"]["hand"]})

    def check_inputs(self, settings: VisionSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """The hand that is drawn must be the one that grasped."""
        used = attributes["grasps"]["settings"]["hand"]
        if attributes["grasps"]["hand"]["digest"] == assets_digest(load_hand(settings.hand).files):  # wherever they lie now
            return
        if used != settings.hand:
            raise InvalidInput(
                f"the grasps were made with hand {used}, render-vision.hand is {settings.hand}; leave it out, or say --set hand={used}"
            )
        raise InvalidInput(f"the files of hand {used} have changed since the grasps were made; run simulate-grasps again")

    def warnings(self, settings: VisionSettings, objects: Iterable[tuple[str, Inputs]]) -> Iterator[str]:
        """Name objects that an image does not hold, or that are too small in it."""
        scene = load_scene(settings.scene)
        cameras = [("the camera", scene.camera), *((f"camera {camera.name}", camera) for camera in scene.cameras)]
        checks = (("not whole in the image of", leaves_image), (f"smaller than {100 * SPECK:.0f} % of the image of", is_speck))
        names: dict[tuple[str, ...], list[str]] = {}
        for name, inputs in objects:
            points = inputs["surfaces"]["points"]
            for fault, has_fault in checks:
                if views := [title for title, camera in cameras if has_fault(camera, points)]:
                    names.setdefault((fault, *views), []).append(name)
        remedy = f"move it or change its focal length in a scene file ({settings.scene}), or scale the objects"
        for (fault, *views), objects_named in names.items():
            yield f"{counted(len(objects_named))} {fault} {', '.join(views)} ({few(objects_named)}): {remedy}"

    def constants(self, settings: VisionSettings) -> Row:
        """The cameras' projection matrices."""
        scene = load_scene(settings.scene)
        found: Row = {"camera": projection_matrix(scene.camera.with_resolution(settings.resolution))}
        if further := _further_cameras(scene, settings):
            found["further_camera"] = np.array([camera.name for camera in scene.cameras])
            found["further_projection"] = np.stack([projection_matrix(camera) for camera in further])
        return found

    def attributes(self, settings: VisionSettings) -> dict[str, Any]:
        """The scene: its lamp, constant light and background are the project's choice, so they are stored with the data."""
        return {"scene": load_scene(settings.scene).model_dump(mode="json")}

    def cost(self, settings: VisionSettings) -> Cost:
        """Six images, or one, with their segmentation, per camera."""
        images = (6 if settings.occluded else 1) * (1 + len(load_scene(settings.scene).cameras))
        pixels = (settings.resolution / 256) ** 2
        return Cost(seconds=0.05 + 0.025 * images * pixels, kilobytes=15 * images * pixels)

    @contextmanager
    def session(self, settings: VisionSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Open one renderer per worker, with the hand's meshes in it."""
        hand = load_hand(settings.hand)
        scene = load_scene(settings.scene)
        further = _further_cameras(scene, settings)
        with Renderer(scene, settings.resolution) as renderer:
            meshes = [(link, renderer.add(mesh, Label.HAND)) for link, mesh in hand.visual_meshes]

            def process(unit: Unit, inputs: Inputs) -> Row:
                grasps = inputs["grasps"]
                frames = forward_kinematics(hand, grasps["hand_pose"], grasps["joint_angles"])  # (grasp, link, 4, 4)
                with renderer.added(read_mesh(inputs["surfaces"]), Label.OBJECT) as handle:
                    return _render_grasps(renderer, (handle, np.eye(4)), meshes, frames if settings.occluded else frames[:0], further)

            yield process


def _further_cameras(scene: Scene, settings: VisionSettings) -> list[Camera]:
    return [camera.with_resolution(settings.resolution) for camera in scene.cameras]


def _render_grasps(renderer: Renderer, posed_object: PosedMesh, hand: HandMeshes, frames: np.ndarray, further: Sequence[Camera]) -> Row:
    """Render the object alone, then with the hand at each of `frames` (grasp, link, 4, 4)."""
    shown = [[posed_object], *([posed_object, *((handle, frame[link]) for link, handle in hand)] for frame in frames)]
    images = [renderer.render(meshes) for meshes in shown]
    row: Row = {"unoccluded": images[0].rgb, "segmentation": np.stack([image.segmentation for image in images])}
    if len(frames):
        row["occluded"] = np.stack([image.rgb for image in images[1:]])
    if further:
        others = [[renderer.render(meshes, camera) for camera in further] for meshes in shown]
        row["further_unoccluded"] = np.array([image.rgb for image in others[0]])  # (camera, row, col, rgb)
        if len(frames):
            row["further_occluded"] = np.array([[image.rgb for image in view] for view in others[1:]])
        row["further_segmentation"] = np.array([[image.segmentation for image in view] for view in others])
        row["further_depth"] = np.array([[image.depth for image in view] for view in others])
    return row
