"""Try a hand: attempt a few grasps of a ball, and list the reasons of those that fail."""

from collections import Counter
from pathlib import Path

import numpy as np
import trimesh

from pipeline.console import Meter, errors
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.hand.kinematics import opening
from pipeline.physics.simulation import Simulation
from pipeline.rng import numpy_rng
from stages.simulate_grasps.grasp_search import GraspSearch
from stages.simulate_grasps.plans import TouchPlanner
from stages.simulate_grasps.prepare import prepare_hand, prepare_object
from stages.simulate_grasps.stage import GraspSettings

ATTEMPTS = 10
SHARE = 0.5
"""Diameter of the ball, as a share of the hand's opening."""
NO_ROOM = "the hand has no room around the ball"
PALM = "let palm.facing and palm.centre of the hand file point to where an object lies; the picture draws them"
NEARER = (
    "the palm's sensors touch what is nearer than their gel is thick: with --set simulate-grasps.least_distance=0 and a "
    "greatest_distance below that"
)
REMEDIES = {
    NO_ROOM: PALM,
    "fingers still move": "lower torque in the hand file",
    "a joint is pushed": "lower torque in the hand file",
    "links of the hand": "write the pairs of the overlap lines into the hand file",
    "a rigid link": "lay the sensors' origins on the surface of their links, and normals outwards, in the hand file",
}
"""What to do if no attempt succeeds, by how the most frequent reason begins."""


def trial_grasps(path: Path) -> list[str]:
    """Attempt to grasp a ball with the hand of a file without faults, as `simulate-grasps` does.

    The lines say how many attempts are grasps, and with how many touches; why the others fail; and a fault if all fail.
    """
    settings = GraspSettings(hand=str(path))
    prepared = prepare_hand(settings)
    radius = SHARE * opening(prepared.hand) / 2
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    ball = Mesh.bare(POSITION + radius * sphere.vertices, np.asarray(sphere.faces))
    prepared_ball = prepare_object(ball, ball.vertices, np.asarray(sphere.vertices), reach=prepared.reach)
    with Simulation(prepared.hand) as physics, Meter(errors, "trial grasps", ATTEMPTS, "attempts", after=1.0) as meter:
        physics.load(ball)
        search = GraspSearch(TouchPlanner(prepared, prepared_ball, settings), physics)
        attempts = []
        for number in range(ATTEMPTS):
            attempts.append(search.attempt(numpy_rng(0, "check", prepared.hand.name, number)))
            meter.advance()
    touches = [int(attempt.grasp.touched.sum()) for attempt in attempts if attempt is not None and attempt.fault is None]
    reasons = Counter(NO_ROOM if attempt is None else attempt.fault for attempt in attempts if attempt is None or attempt.fault)
    summary = f"trial: {len(touches)} of {ATTEMPTS} attempts at a ball of {2e3 * radius:.0f} mm are grasps"
    if touches:
        summary += f", which touch with {np.mean(touches):.1f} of {len(prepared.sensors)} sensors"
    lines = [summary, *(f"trial: {count} failed: {reason}" for reason, count in reasons.most_common())]
    if not touches:
        worst = str(reasons.most_common(1)[0][0])
        remedy = next(remedy for reason, remedy in REMEDIES.items() if worst.startswith(reason))
        lines.append(f"fault: no attempt is a grasp, mostly because {worst}; {remedy}")
    elif not any(touches):
        on_palm = not any(finger.sensors for finger in prepared.hand.fingers)
        fault = f"fault: no sensor touches the ball: do the sensors' normals point out of their links? Else {PALM}"
        lines.append(f"trial: {NEARER}" if on_palm else fault)
    return lines
