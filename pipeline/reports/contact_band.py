"""From the arrays of one grasp to its band on the contact sheet, with the second side rendered."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from pipeline.config.hand_file import load_hand
from pipeline.config.scene_file import load_scene
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.vision.labels import Label
from pipeline.kernels.vision.scene import Scene
from pipeline.reports.contact_sheet import Band, finger_colors
from pipeline.reports.second_view import GraspView, gel_squares, second_view, touch_patch
from stages.render_vision.renderer import Renderer


class BandMaker:
    """Makes bands for one hand in one scene; `band_maker` opens one."""

    def __init__(self, renderer: Renderer, scene: Scene, hand: Hand, width: float, gel: float) -> None:
        """Take the hand's shapes into the renderer; the sensors' square is `width` m wide and their gel `gel` m thick."""
        self.renderer, self.scene, self.hand, self.width, self.gel = renderer, scene, hand, width, gel
        self.shapes = [(link, renderer.add(mesh, Label.HAND), mesh) for link, mesh in hand.visual_meshes]

    def band(
        self,
        title: str,
        note: str,
        mesh: Mesh,
        hand_pose: NDArray[np.float64],
        joint_angles: NDArray[np.float64],
        sensor_pose: NDArray[np.float64],
        touched: NDArray[np.bool_],
        readings: NDArray[np.uint8],
        depths: NDArray[np.float32],
        unoccluded: NDArray[np.uint8],
        occluded: NDArray[np.uint8],
    ) -> Band:
        """One object's band, for one of its grasps: arrays as the stages wrote them, object and grasp dimensions taken off."""
        frames = forward_kinematics(self.hand, hand_pose, joint_angles)  # (L, 4, 4)
        colors = finger_colors(len(touched))
        made = [
            touch_patch(depth, pose, width=self.width, gel=self.gel, color=color)
            for depth, pose, color, good in zip(depths, sensor_pose, colors, touched, strict=True)
            if good
        ]
        with self.renderer.added(mesh, Label.OBJECT) as handle:
            grasp = GraspView(
                object_mesh=(handle, mesh),
                hand=[(shape, surface, frames[link]) for link, shape, surface in self.shapes],
                patches=[surface for surface in made if surface is not None],
                palm=hand_pose[:3, :3] @ self.hand.palm_facing,
                squares=gel_squares(sensor_pose, self.width, self.gel),
                colors=colors,
            )
            held, felt = second_view(self.renderer, self.scene, len(unoccluded), grasp)
        pictures = [("unoccluded", unoccluded), ("occluded", occluded), ("from a second side", held), ("touch sites", felt)]
        return Band(title, note, pictures, [finger.name for finger in self.hand.fingers], touched, readings, depths)


@contextmanager
def band_maker(scene: str, hand: str, width: float, gel: float) -> Iterator[BandMaker]:
    """A `BandMaker` for the scene and the hand of these names, for as long as the context lasts."""
    surroundings = load_scene(scene)
    with Renderer(surroundings) as renderer:
        yield BandMaker(renderer, surroundings, load_hand(hand), width, gel)
