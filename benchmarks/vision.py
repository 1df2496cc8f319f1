"""Time one image and its segmentation, of the dataset's objects in the hand and alone."""

from pathlib import Path

import numpy as np

from benchmarks.cases import touched_objects
from benchmarks.timing import Table, over_items, side_by_side
from pipeline.formats.hand_file import load_hand
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.vision.scene import Label
from stages.render_vision.renderer import Renderer


def measure(data: Path, turns: int) -> Table:
    """Measure all cases, `turns` images of each kind."""
    cases, hand = touched_objects(data), load_hand("allegro_right")
    pose = np.eye(4)
    pose[:3, 3] = [0.05, 0.1, 0.65]
    frames = forward_kinematics(hand, pose, np.clip(np.full(len(hand.joint_names), 0.6), hand.lower, hand.upper))
    with Renderer(load_scene("supplement")) as renderer:
        links = [(renderer.add(mesh, Label.HAND), frames[link]) for link, mesh in hand.visual_meshes]
        handles = [renderer.add(case.mesh, Label.OBJECT) for case in cases]
        scenes = {"unoccluded image": [], "occluded image": links}
        draw = {name: lambda handle, posed=posed: renderer.render([(handle, np.eye(4)), *posed]) for name, posed in scenes.items()}
        times = side_by_side({name: over_items(call, handles) for name, call in draw.items()}, turns)
    resolution = load_scene("supplement").camera.resolution
    note = f"Mean of {len(cases)} objects, {resolution} × {resolution} pixels, processor milliseconds; least / median."
    table = Table("Vision: one image with its segmentation", ["ms per image"], [note])
    for name, measured in times.items():
        table.add(name, measured)
    return table
