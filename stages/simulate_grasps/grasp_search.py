"""Attempts at a grasp: pose the palm, solve for the fingers, close them in physics, and measure the outcome."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.grasp_closure import Contact, closure_margin, contact_from_depth, opposition_angle
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.object_distances import finger_clearance, penetration_depth
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.kernels.hand.self_collision import hand_gap
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.physics.simulation import Simulation
from stages.simulate_grasps.prepare import PreparedHand, PreparedObject
from stages.simulate_grasps.settings import GraspSettings


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp as simulated; `fault` is why it cannot be kept: it moves, leaves its joint limits, or penetrates itself or the object.

    `find_contacts` gives the contacts of the sensors that touch, None for the others, and `find_closure` their margin; each is computed
    at its first use. The fingers closed from `pregrasp_angles`; `holds` says that the grasp passed the hold test of a hold search, in
    which the object moved by `motions`, (D, 2), m and m/s, at the end of each direction.
    """

    hand_pose: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    sensor_pose: NDArray[np.float64]
    touched: NDArray[np.bool_]
    penetration: float
    fault: str | None
    find_contacts: Callable[[], Sequence[Contact | None]] = tuple
    find_closure: Callable[[list[Contact]], float] = lambda contacts: 0.0
    pregrasp_angles: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    holds: bool = False
    motions: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 2), np.float32))

    @property
    def sound(self) -> bool:
        """Whether it may be kept."""
        return self.fault is None

    @cached_property
    def contacts(self) -> Sequence[Contact | None]:
        """Contacts of the S sensors; None for one that does not touch."""
        return self.find_contacts()

    @cached_property
    def closure(self) -> float:
        """The margin of force closure."""
        return self.find_closure([contact for contact in self.contacts if contact])

    @property
    def contact_area(self) -> NDArray[np.float64]:
        """(S,) m²; 0 for a sensor that does not touch."""
        return np.array([contact.area if contact else 0.0 for contact in self.contacts])

    @property
    def opposition(self) -> float:
        """The greatest angle between two contacts' normals, degrees."""
        return opposition_angle([contact for contact in self.contacts if contact])


class GraspPlan(NamedTuple):
    """A grasp before physics: the pose of the hand (4, 4), and joint angles (J,) with which its gels press into the object."""

    hand_pose: NDArray[np.float64]
    joint_angles: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GraspSearch:
    """The search for grasps of one object, which `physics` has loaded, by plans that depend on a random generator alone."""

    prepared_hand: PreparedHand
    prepared_object: PreparedObject
    physics: Simulation
    settings: GraspSettings
    plan: Callable[[np.random.Generator], GraspPlan | None]

    def attempt(self, rng: np.random.Generator) -> Grasp | None:
        """Make one grasp, which depends on the search and `rng` alone; None where there is no plan."""
        plan = self.plan(rng)
        return None if plan is None else self._close(*plan)

    def _close(self, pose: NDArray[np.float64], target: NDArray[np.float64]) -> Grasp:
        """Close the fingers to a target posture and measure where they come to rest."""
        hand, ik = self.prepared_hand.hand, self.prepared_hand.ik
        start = self._pregrasp(pose, target)
        steps, speed = self.settings.settle_steps, self.settings.resting_speed
        angles, rests = self.physics.settle(pose, start, target, max_steps=steps, resting_speed=speed)
        frames = forward_kinematics(hand, pose, angles)
        poses = sensor_poses_from_links(hand, frames)
        sites = list(zip(poses, self.prepared_hand.sensors, strict=True))
        depths = [ray_depth(self.prepared_object.faces, pose, sensor) for pose, sensor in sites]
        touched = np.array([touch_success(depth, sensor) for depth, (_, sensor) in zip(depths, sites, strict=True)])
        penetration = penetration_depth(self.prepared_object.field, self.prepared_hand.spheres, frames)
        fault = None
        if not rests:
            fault = f"fingers still move after {steps} steps (simulate-grasps.settle_steps)"
        elif not ((angles >= hand.lower) & (angles <= hand.upper)).all():
            fault = "a joint is pushed beyond its limit"
        elif hand_gap(hand, ik.boxes, frames) < 0:
            fault = "links of the hand overlap"
        elif penetration > self.settings.penetration_limit:
            limit = 1e3 * self.settings.penetration_limit
            fault = f"a rigid link is more than {limit:g} mm inside the object (simulate-grasps.penetration_limit)"

        def contacts() -> list[Contact | None]:
            return [contact_from_depth(depth, *site) if touch else None for depth, site, touch in zip(depths, sites, touched, strict=True)]

        return Grasp(pose, angles, poses, touched, penetration, fault, contacts, self._closure, start)

    def _closure(self, contacts: list[Contact]) -> float:
        points = self.prepared_object.points
        size = float(length(points.max(axis=0) - points.min(axis=0))) / 2
        return closure_margin(contacts, friction=self.prepared_hand.hand.friction, size=size)

    def _pregrasp(self, pose: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the joint angles from which the fingers close: each finger is drawn back as far as there is room behind it."""
        hand, ik = self.prepared_hand.hand, self.prepared_hand.ik
        postures = pregrasp_angles(hand, target, [share * self.settings.opening for share in (1.0, 0.5, 0.0)])
        clear = finger_clearance(self.prepared_object.field, ik.fingers, forward_kinematics(hand, pose, postures), floor=0.0) >= 0  # (3, S)
        start = target.copy()
        for s, finger in enumerate(hand.fingers):
            if clear[:, s].any():
                start[list(finger.joints)] = postures[clear[:, s].argmax()][list(finger.joints)]
        fits = hand_gap(hand, ik.boxes, forward_kinematics(hand, pose, start)) >= 0
        return start if fits else target


SCORES: dict[str, Callable[[Grasp], tuple[float, ...]]] = {
    "touches": lambda grasp: (int(grasp.touched.sum()),),
    "area": lambda grasp: (float(grasp.contact_area.sum()),),
    "closure": lambda grasp: (grasp.closure, int(grasp.touched.sum())),
}
"""Scores of a grasp, the greatest is best, by the setting `prefer`."""


def keep_best(kept: list[Grasp], grasp: Grasp | None, count: int, prefer: str = "touches") -> list[Grasp]:
    """Keep the best sound grasps so far, those that hold first.

    Parameters
    ----------
    kept
        The best ones before this grasp, best first.
    grasp
        The next one; None if the attempt failed.
    count
        Limit of the number kept.
    prefer
        A key of `SCORES`.

    Returns
    -------
    The best ones, best first, the earlier of equals first.
    """
    if grasp is None or not grasp.sound:
        return kept
    return sorted([*kept, grasp], key=lambda candidate: tuple(-value for value in (candidate.holds, *SCORES[prefer](candidate))))[
        :count
    ]  # a stable sort
