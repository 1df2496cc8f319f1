"""One attempt at a grasp: place the palm, solve for the fingers, let physics close them, and measure what came of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand.approach import draw_back
from pipeline.kernels.hand.choice import hand_gap
from pipeline.kernels.hand.clearance import deepest
from pipeline.kernels.hand.inverse import has_room, solve
from pipeline.kernels.hand.kinematics import forward, sensors_on
from pipeline.kernels.hand.placement import tangent_pose
from pipeline.kernels.hand.reach import ball_points, finger_clearance
from pipeline.kernels.touch.contact import touch_success
from pipeline.kernels.touch.ray_depth import ray_depth
from stages.simulate_grasps.physics import Simulation
from stages.simulate_grasps.rig import Rig, Scene
from stages.simulate_grasps.settings import GraspSettings

PLACEMENTS = 40
"""Draws of palm point, distance and rotation in an attempt; one at which the hand would stand in the object is drawn again."""
SEARCHES = 3
"""Placements of an attempt that are searched in vain for postures in which no finger is in another's way, before it is given up."""
LEAST_STEPS = 20
"""Steps before a hand can count as resting: it starts at rest."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp as simulated; `sound` when it rests, keeps its joint limits and stands neither in the object nor in itself.

    Of one that cannot be kept anyway only its touches count: it is not called sound, and its penetration is NaN where nobody asked.
    """

    hand_pose: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    sensor_pose: NDArray[np.float64]
    touched: NDArray[np.bool_]
    penetration: float
    sound: bool


def attempt(
    rig: Rig, scene: Scene, physics: Simulation, settings: GraspSettings, rng: np.random.Generator, fewest: int = 0
) -> Grasp | None:
    """A grasp that depends on its arguments alone, or None where the hand found no room around the object.

    `fewest` touches it must have to be kept: of one with fewer nothing else is measured.
    """
    searches = 0
    for _ in range(PLACEMENTS):
        pose = _draw_pose(rig, scene, settings, rng)
        if not _has_room(rig, scene, pose, settings.clearance):
            continue
        solved = solve(rig.hand, rig.parts, rig.boxes, rig.samples, scene.field, pose, rig.wanted, settings.ik_refinements, rng)
        if solved.joint_angles is not None:
            return _close(rig, scene, physics, settings, pose, solved.joint_angles, fewest)
        searches += 1
        if searches == SEARCHES:
            break
    return None


def keep_best(kept: list[Grasp], grasp: Grasp | None, count: int) -> list[Grasp]:
    """The `count` sound grasps with most touches so far, the earlier of equals first."""
    if grasp is None or not grasp.sound:
        return kept
    return sorted([*kept, grasp], key=lambda one: -int(one.touched.sum()))[:count]  # a stable sort


def fewest_to_keep(kept: list[Grasp], count: int) -> int:
    """Touches with which a sound grasp still comes among the `count` best, beside those `kept` so far."""
    return int(kept[-1].touched.sum()) + 1 if len(kept) == count else 0


def _draw_pose(rig: Rig, scene: Scene, settings: GraspSettings, rng: np.random.Generator) -> NDArray[np.float64]:
    """The palm tangent at a random surface point, random distance, random rotation in the plane."""
    index = rng.integers(len(scene.points))
    distance = rng.uniform(settings.least_distance, settings.greatest_distance)
    return tangent_pose(rig.hand, scene.points[index], scene.normals[index], distance, rng.uniform(0, 2 * np.pi))


def _has_room(rig: Rig, scene: Scene, pose: NDArray[np.float64], clearance: float) -> bool:
    """Whether the palm keeps clear of the object, and every finger can."""
    frames = forward(rig.hand, pose, rig.hand.lower)[None]
    gap = scene.field.exact(ball_points(rig.palm, frames)[:, 0].T) - rig.palm.radii
    return bool((gap >= clearance).all()) and has_room(rig.hand, rig.parts, rig.samples, scene.field, pose, clearance)


def _opened(rig: Rig, scene: Scene, pose: NDArray[np.float64], target: NDArray[np.float64], opening: float) -> NDArray[np.float64]:
    """Where the fingers close from: drawn back as far as there is room behind each of them."""
    ways = draw_back(rig.hand, target, [share * opening for share in (1.0, 0.5, 0.0)])
    clear = finger_clearance(scene.field, rig.parts, forward(rig.hand, pose, ways)) >= 0  # (3, S)
    start = target.copy()
    for s, finger in enumerate(rig.hand.fingers):
        start[list(finger.joints)] = ways[clear[:, s].argmax()][list(finger.joints)] if clear[:, s].any() else target[list(finger.joints)]
    apart = hand_gap(rig.hand, rig.boxes, forward(rig.hand, pose, start)) >= 0
    return start if apart else target


def _close(
    rig: Rig,
    scene: Scene,
    physics: Simulation,
    settings: GraspSettings,
    pose: NDArray[np.float64],
    target: NDArray[np.float64],
    fewest: int,
) -> Grasp:
    start = _opened(rig, scene, pose, target, settings.opening)
    angles, rests = physics.settle(pose, start, target, (LEAST_STEPS, settings.settle_steps), settings.resting_speed)
    frames = forward(rig.hand, pose, angles)
    sensors = sensors_on(rig.hand, frames)
    touched = np.array([touch_success(ray_depth(scene.faces, sensor, rig.sensor), rig.sensor) for sensor in sensors])
    within = bool(((angles >= rig.hand.lower) & (angles <= rig.hand.upper)).all())
    if not (rests and within and touched.sum() >= fewest and hand_gap(rig.hand, rig.boxes, frames) >= 0):
        return Grasp(pose, angles, sensors, touched, np.nan, sound=False)
    penetration = deepest(scene.field, rig.dense, frames)
    return Grasp(pose, angles, sensors, touched, penetration, sound=penetration <= settings.penetration_limit)
