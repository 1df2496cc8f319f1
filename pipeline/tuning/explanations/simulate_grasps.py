"""What `simulate-grasps` left out: attempts that could not be kept, postures that cannot be best, what no contact depends on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.engine.stage import Task
from pipeline.kernels.hand.clearance import doubtful
from pipeline.kernels.hand.inverse import looked_at, solve
from pipeline.kernels.hand.kinematics import forward
from pipeline.kernels.hand.reach import ball_points
from pipeline.tuning.explain import Count
from stages.simulate_grasps.rig import Rig, Scene, make_rig, make_scene
from stages.simulate_grasps.settings import GraspSettings


def explain(settings: GraspSettings, models: Mapping[str, Path], tasks: Sequence[Task]) -> Iterator[Count]:
    """Count attempts of these objects, and what was looked at around their kept grasps."""
    rig = make_rig(settings)
    for task in tasks:
        surface, row = task.inputs["surfaces"], task.inputs["grasps"]
        made = int(row["attempts"])
        yield Count("attempts", made, max(settings.attempts - made, 0), "no further one could be kept", "enough attempts")
        scene = make_scene(task.mesh(), surface["points"], surface["normals"], settings.grid_cell)
        exact = int(scene.field.records[:, 1:].any(axis=1).sum())
        cells = len(scene.field.records)
        yield Count("grid cells measured", exact, cells - exact, "farther from the object than any part of a hand is asked about")
        for pose, angles in zip(row["hand_pose"], row["joint_angles"], strict=True):
            rng = task.rng("explain")
            found = solve(rig.hand, rig.parts, rig.boxes, rig.samples, scene.field, pose, rig.wanted, settings.ik_refinements, rng)
            why = "its contact or its tip already keeps the posture from being the best"
            yield Count("fingers measured whole, a posture around kept grasps", found.measured, found.spared, why, "bounds first")
            yield from _grasp(rig, scene, pose, angles)


def _grasp(rig: Rig, scene: Scene, pose: np.ndarray, angles: np.ndarray) -> Iterator[Count]:
    """What was looked at for one kept grasp."""
    postures = rig.samples.free.size
    looked = looked_at(rig.samples, scene.field, pose, rig.wanted).size
    yield Count("sampled postures told apart by room", looked, postures - looked, "others of the same finger press in farther")
    points = ball_points(rig.dense, forward(rig.hand, pose, angles)[None])[:, 0]
    balls = len(rig.dense.radii)
    measured = len(doubtful(scene.field, rig.dense, points))
    yield Count("balls measured exactly", measured, balls - measured, "clear of the object by the grid already", "doubtful balls")
