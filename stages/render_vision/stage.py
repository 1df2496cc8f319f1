"""Supplement 1.4: an image of the object alone, and one of each grasp with the hand in front of it or behind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.scene_file import load_scene, scene_path
from pipeline.engine.stage import Cost, Task
from pipeline.errors import InvalidInput
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.hand.model import load_hand
from pipeline.kernels.hand.visuals import visual_meshes
from pipeline.kernels.vision.camera import projection_matrix
from pipeline.kernels.vision.context import shader_paths
from pipeline.kernels.vision.raster import RasterRenderer
from pipeline.kernels.vision.view import Label, Part, Placed, Renderer
from pipeline.store.pieces import Row
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.vision import VISION
from stages.render_vision.settings import VisionSettings

HandParts = list[tuple[int, Part]]
"""The hand's link numbers, and what the renderer calls their shapes."""


class RenderVision:
    """From objects and hands where they stand to what a camera sees."""

    name = "render-vision"
    summary = "Images of every object alone and in every grasp, with segmentation."
    output = VISION
    settings_type = VisionSettings

    def inputs(self, settings: VisionSettings) -> tuple[Artifact, ...]:
        """The meshes, and where hand and sensors stand."""
        return (SURFACES, GRASPS)

    def models(self, settings: VisionSettings) -> tuple[str, ...]:
        """None."""
        return ()

    def assets(self, settings: VisionSettings) -> list[Path]:
        """The scene, the hand with its shapes, and the shaders."""
        return [scene_path(settings.scene), *load_hand(settings.hand).files, *shader_paths()]

    def constants(self, settings: VisionSettings) -> Row:
        """The camera's projection matrix."""
        return {"camera": projection_matrix(load_scene(settings.scene).camera.at(settings.resolution))}

    def attributes(self, settings: VisionSettings) -> dict[str, Any]:
        """The scene: its lamp, constant light and background are the project's choice, so they stand with the data."""
        return {"scene": load_scene(settings.scene).model_dump(mode="json")}

    def cost(self, settings: VisionSettings) -> Cost:
        """Six images, or one, with their segmentation, as measured on real meshes."""
        images, pixels = (6 if settings.occluded else 1), (settings.resolution / 256) ** 2
        return Cost(seconds=0.05 + 0.025 * images * pixels, kilobytes=15 * images * pixels)

    @contextmanager
    def session(self, settings: VisionSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Task], Row]]:
        """One renderer a worker, with the hand's shapes in it."""
        hand = load_hand(settings.hand)
        with RasterRenderer(load_scene(settings.scene), settings.resolution) as renderer:
            shapes = [(link, renderer.add(mesh, Label.HAND)) for link, mesh in visual_meshes(hand)]

            def process(task: Task) -> Row:
                _check_hand(task, settings)
                grasps = task.inputs["grasps"]
                frames = forward(hand, grasps["hand_pose"], grasps["joint_angles"])  # (grasp, link, 4, 4)
                part = renderer.add(task.mesh(), Label.OBJECT)
                try:
                    return _images(renderer, (part, np.eye(4)), shapes, frames if settings.occluded else frames[:0])
                finally:
                    renderer.remove(part)

            yield process


def _check_hand(task: Task, settings: VisionSettings) -> None:
    held = task.attributes["grasps"]["settings"]["hand"]
    if held != settings.hand:
        raise InvalidInput(f"the grasps were made with hand {held}, render-vision.hand is {settings.hand}; set both with --set hand={held}")


def _images(renderer: Renderer, thing: Placed, shapes: HandParts, frames: np.ndarray) -> Row:
    """The object alone, then with the hand at each of `frames` (grasp, link, 4, 4)."""
    alone = renderer.render([thing])
    held = [renderer.render([thing, *((part, frame[link]) for link, part in shapes)]) for frame in frames]
    row: Row = {"unoccluded": alone.rgb, "segmentation": np.stack([view.segmentation for view in (alone, *held)])}
    if held:
        row["occluded"] = np.stack([view.rgb for view in held])
    return row
