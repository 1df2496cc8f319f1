"""`python -m benchmarks.vision`: what an image costs, with its segmentation."""

from __future__ import annotations

import time
from functools import partial
from statistics import median

import numpy as np

from benchmarks.timing import alone, side_by_side
from pipeline.formats.hand_file import load_hand
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.vision.labels import Label
from pipeline.toy_objects import CATEGORIES, generate
from stages.render_vision.renderer import Renderer

TURNS = 20
PEER_NAME, PEER = "occluded image, the authors' simulator", 91.0
"""As measured on a machine like this one, ms per image and CPU core."""


def measure() -> dict[str, float]:
    """Measure median milliseconds: a renderer opened, an object added with its first image, and images after that."""
    hand = load_hand("allegro_right")
    pose = np.eye(4)
    pose[:3, 3] = [0.05, 0.1, 0.65]
    frames = forward_kinematics(hand, pose, np.clip(np.full(len(hand.joint_names), 0.6), hand.lower, hand.upper))
    began = time.process_time()
    found: dict[str, list[float]] = {"first image of an object": [], "unoccluded image": [], "occluded image": []}
    with Renderer(load_scene("supplement")) as renderer:
        opened = (time.process_time() - began) * 1e3
        links = [(renderer.add(mesh, Label.HAND), frames[link]) for link, mesh in hand.visual_meshes]
        for category in CATEGORIES:
            mesh = generate(category, np.random.default_rng(0))
            to_world = np.diag([0.5 / np.linalg.norm(np.ptp(mesh.vertices, axis=0))] * 3 + [1.0])
            to_world[:3, 3] = [0, 0, 0.6]
            began = time.process_time()
            handle = renderer.add(mesh, Label.OBJECT)
            renderer.render([(handle, to_world)])
            found["first image of an object"].append((time.process_time() - began) * 1e3)
            scenes = {"unoccluded image": [(handle, to_world)], "occluded image": [(handle, to_world), *links]}
            times = side_by_side({name: alone(partial(renderer.render, meshes)) for name, meshes in scenes.items()}, TURNS)
            for name, one in times.items():
                found[name].append(one.median)
            renderer.remove(handle)
    return {"open a renderer": opened, **{name: median(values) for name, values in found.items()}}


if __name__ == "__main__":
    for what, milliseconds in measure().items():
        print(f"{what:40s} {milliseconds:8.1f} ms")
    print(f"{PEER_NAME:40s} {PEER:8.1f} ms")
