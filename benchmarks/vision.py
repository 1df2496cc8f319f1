"""What an image costs: `python -m benchmarks.vision`."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.config.hand_file import load_hand
from pipeline.config.scene_file import load_scene
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.vision.labels import Label
from pipeline.toy_objects import CATEGORIES, generate
from stages.render_vision.renderer import MeshHandle, PosedMesh, Renderer

REPEATS = 20
PEER_NAME, PEER = "occluded image, the authors' simulator", 91.0
"""As measured on a machine like this one, ms a CPU core."""


Result = TypeVar("Result")


def timed(action: Callable[[], Result]) -> tuple[float, Result]:
    """Milliseconds, and what came of it."""
    start = time.perf_counter()
    result = action()
    return (time.perf_counter() - start) * 1e3, result


def image_times(renderer: Renderer, parts: list[PosedMesh]) -> list[float]:
    """Milliseconds of `REPEATS` images, the first one apart."""
    renderer.render(parts)
    return [timed(partial(renderer.render, parts))[0] for _ in range(REPEATS)]


def take_in(renderer: Renderer, mesh: Mesh, place: NDArray[np.float64]) -> MeshHandle:
    """The object in the renderer, its first image made."""
    part = renderer.add(mesh, Label.OBJECT)
    renderer.render([(part, place)])
    return part


def measure() -> dict[str, float]:
    """Milliseconds: renderer and hand opened, an object taken in with its first image, and images after that (medians)."""
    hand = load_hand("allegro_right")
    angles = np.clip(np.full(len(hand.joint_names), 0.6), hand.lower, hand.upper)
    stand = np.eye(4)
    stand[:3, 3] = [0.05, 0.1, 0.65]
    frames = forward(hand, stand, angles)
    opened, renderer = timed(lambda: Renderer(load_scene("supplement")))
    first: list[float] = []
    occluded: list[float] = []
    unoccluded: list[float] = []
    with renderer:
        grip = [(renderer.add(mesh, Label.HAND), frames[link]) for link, mesh in hand.visual_meshes]
        for category in CATEGORIES:
            mesh = generate(category, np.random.default_rng(0))
            size = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
            place = np.diag([0.5 / size] * 3 + [1.0])
            place[:3, 3] = [0, 0, 0.6]

            took, part = timed(partial(take_in, renderer, mesh, place))
            first.append(took)
            occluded += image_times(renderer, [(part, place), *grip])
            unoccluded += image_times(renderer, [(part, place)])
            renderer.remove(part)
    return {
        "open a renderer": opened,
        "first object and its image": first[0],
        "later objects and their images": median(first[1:]),
        "unoccluded image with segmentation": median(unoccluded),
        "occluded image with segmentation": median(occluded),
    }


if __name__ == "__main__":
    for what, milliseconds in measure().items():
        print(f"{what:40s} {milliseconds:8.1f} ms")
    print(f"{PEER_NAME:40s} {PEER:8.1f} ms")
