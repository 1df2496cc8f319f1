"""Plans of the supplement (1.3): a palm tangent to the object at random, fingers that touch it where they can."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.hand.distance_field import near_gaps
from pipeline.kernels.hand.grasp_ik import fingers_fit, grasp_ik
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.pregrasp import tangent_palm_pose
from stages.simulate_grasps.grasp_search import Posture
from stages.simulate_grasps.prepare import CLEARANCE, PreparedHand, PreparedObject
from stages.simulate_grasps.stage import GraspSettings

MAX_POSES = 40
"""Most draws of palm point, distance and rotation per plan; a draw at which the hand would be in the object is repeated."""
MAX_SEARCHES = 3
"""Poses per plan for which the inverse kinematics may fail before the plan is given up."""


@dataclass(frozen=True, eq=False)
class TouchPlanner:
    """Plan grasps of one object that touch it with as many sensors as they can."""

    prepared_hand: PreparedHand
    prepared_object: PreparedObject
    settings: GraspSettings

    def __call__(self, rng: np.random.Generator) -> Posture | None:
        """Plan a posture; None where the hand has no room around the object."""
        for pose in islice(self.poses_with_room(rng), MAX_SEARCHES):
            choices = grasp_ik(self.prepared_hand.ik, self.prepared_object.field, pose, rounds=self.settings.ik_refinements, rng=rng)
            if len(choices.picks):
                return pose, choices.joint_angles(0)
        return None

    def poses_with_room(self, rng: np.random.Generator) -> Iterator[NDArray[np.float64]]:
        """Draw poses (4, 4) of the hand, and yield those at which palm and fingers can stay clear of the object."""
        return filter(self._has_room, (self._draw_hand_pose(rng) for _ in range(MAX_POSES)))

    def _draw_hand_pose(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw a pose (4, 4): the palm tangent at a random surface point, at a random distance, randomly turned in the plane."""
        index = rng.integers(len(self.prepared_object.points))
        point, normal = self.prepared_object.points[index], self.prepared_object.normals[index]
        distance = rng.uniform(self.settings.least_distance, self.settings.greatest_distance)
        return tangent_palm_pose(self.prepared_hand.hand, point, normal, distance=distance, angle=rng.uniform(0, 2 * np.pi))

    def _has_room(self, pose: NDArray[np.float64]) -> bool:
        """Check whether the palm stays clear of the object, and every finger can."""
        hand, palm, field = self.prepared_hand.hand, self.prepared_hand.palm_spheres, self.prepared_object.field
        gaps = near_gaps(field, palm, forward_kinematics(hand, pose, hand.lower), CLEARANCE)
        return bool((gaps >= CLEARANCE).all()) and fingers_fit(self.prepared_hand.ik, field, pose)
