"""Warnings before a run: objects that are too small or too large for the hand or for an image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.console import counted, few
from pipeline.engine.plan import Plan
from pipeline.formats.hand_file import load_hand
from pipeline.formats.physics_urdf import links_without_mass
from pipeline.formats.scene_file import load_scene
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.hand.kinematics import forward_kinematics, sensors_of_links
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.vision.camera import Camera, project_points, projection_matrix
from pipeline.rng import numpy_rng
from pipeline.store.publish import ShardOutput
from stages.render_vision.settings import VisionSettings
from stages.simulate_grasps.settings import GraspSettings

SPECK = 0.1
"""Share of an image's side below which an object is too small."""
POSTURES = 512
"""Random postures by which the opening of a hand is measured."""


def size_warnings(plan: Plan[ShardOutput]) -> Iterator[str]:
    """Warn before a run of `simulate-grasps` or `render-vision` about objects of unfit size, each line with a remedy."""
    if isinstance(plan.settings, GraspSettings):
        hand = load_hand(plan.settings.hand)
        if massless := links_without_mass(hand):
            yield f"hand {hand.name}: its URDF states no mass for {few(massless)}; estimated from collision shapes at 1000 kg/m³"
        widest = max(sensor.width for sensor in load_worn_sensors(sensor_names(hand, plan.settings.sensor)))
        extents = {name: np.ptp(points, axis=0) for name, points in _points(plan)}
        yield from _size_warnings(extents, smallest=2 * widest, largest=opening(hand), hand=hand.name)
    if isinstance(plan.settings, VisionSettings):
        scene = load_scene(plan.settings.scene)
        cameras = [("the camera", scene.camera), *((f"camera {camera.name}", camera) for camera in scene.cameras)]
        faults: dict[tuple[str, ...], list[str]] = {}
        for name, points in _points(plan):
            for fault, applies in (
                ("not whole in the image of", leaves_image),
                (f"smaller than {100 * SPECK:.0f} % of the image of", is_speck),
            ):
                if views := [title for title, camera in cameras if applies(camera, points)]:
                    faults.setdefault((fault, *views), []).append(name)
        for (fault, *views), names in faults.items():
            remedy = f"move it or change its focal length in a scene file ({plan.settings.scene}), or scale the objects"
            yield f"{counted(len(names))} {fault} {', '.join(views)} ({few(names)}): {remedy}"


def _points(plan: Plan[ShardOutput]) -> Iterator[tuple[str, np.ndarray]]:
    """Read the exterior points of each object that a run would make, world frame, m."""
    surfaces = next(collection for collection in plan.inputs if collection.artifact.name == "surfaces")
    for unit in plan.units:
        if plan.request.only in (None, unit.name) and surfaces.failure(unit.name) is None:
            yield unit.name, surfaces.view(unit.name)["points"]


def _size_warnings(extents: dict[str, np.ndarray], *, smallest: float, largest: float, hand: str) -> Iterator[str]:
    small = [name for name, sides in extents.items() if sides.max() < smallest]
    large = [name for name, sides in extents.items() if sides.min() > largest]
    if small:
        yield (
            f"{counted(len(small))} smaller than two sensors of {hand} side by side, {1e3 * smallest:.0f} mm ({few(small)}): "
            "is the unit right?"
        )
    if large:
        yield (
            f"{counted(len(large))} wider on every side than {hand} opens, {1e3 * largest:.0f} mm ({few(large)}): fingers touch "
            "one side only, if any; is the unit right?"
        )


def sensor_places(hand: Hand) -> NDArray[np.float64]:
    """Compute the positions of S sensors in P postures, random ones and the joints' limits: (P, S, 3), frame of the palm's link, m."""
    angles = numpy_rng(0, "opening", hand.name).uniform(hand.lower, hand.upper, (POSTURES, len(hand.lower)))
    frames = forward_kinematics(hand, np.eye(4), np.concatenate([angles, [hand.lower, hand.upper]]))
    return sensors_of_links(hand, frames)[..., :3, 3]


def opening(hand: Hand) -> float:
    """Compute the opening of a hand: the greatest distance between two sensors, or a sensor and the palm's centre, m."""
    places = sensor_places(hand)
    palm = np.broadcast_to(hand.palm_centre, (len(places), 1, 3))
    ends = np.concatenate([places, palm], axis=1)
    return float(np.linalg.norm(ends[:, :, None] - ends[:, None], axis=-1).max())


def leaves_image(camera: Camera, points: np.ndarray) -> bool:
    """Tell whether any of the points (N, 3), world frame, m, is outside a camera's image."""
    rows, cols = camera.shape
    places = project_points(projection_matrix(camera), points.astype(np.float64))
    return not bool(((places >= 0) & (places <= [cols, rows])).all())  # NaN behind the camera is not


def is_speck(camera: Camera, points: np.ndarray) -> bool:
    """Tell whether points (N, 3), world frame, m, span less than `SPECK` of a camera's image both ways."""
    rows, cols = camera.shape
    spans = np.ptp(project_points(projection_matrix(camera), points.astype(np.float64)), axis=0)
    return bool((spans < [SPECK * cols, SPECK * rows]).all())
