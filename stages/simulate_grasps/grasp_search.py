"""Attempts at a grasp: plan, close the fingers in physics, and measure where they come to rest."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.distance_field import finger_clearance, penetration_depth
from pipeline.kernels.hand.grasp import Grasp, closure_margin, contact_from_depth
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.kernels.hand.self_collision import hand_gap
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.physics.simulation import Simulation
from stages.simulate_grasps.prepare import PreparedHand, PreparedObject
from stages.simulate_grasps.stage import GraspSettings

OPENING = 0.006
"""m that each sensor is drawn back before it closes: about a gel's thickness; 0 and 12 mm touch as often."""
RESTING_SPEED = 2e-3
"""rad/s below which a joint rests, a tenth of it in m/s where it slides: at most 1 µm of the sensor's way in one step."""

Posture = tuple[NDArray[np.float64], NDArray[np.float64]]
"""A hand's pose (4, 4) and joint angles (J,)."""
Planner = Callable[[np.random.Generator], Posture | None]
"""Plans a posture in which gels press into the object; None where the hand has no room around it."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """A grasp as simulated."""

    grasp: Grasp
    penetration: float  # m, of the deepest rigid point in the object
    fault: str | None  # why it cannot be kept: it moves, leaves its joint limits, or penetrates itself or the object
    holds: bool = False  # it passed the hold test of a hold search
    motions: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 2), np.float32))  # (D, 2) m, m/s, of the object in that test


@dataclass(frozen=True, eq=False)
class GraspSearch:
    """The search for grasps of one object, which `physics` has loaded."""

    prepared_hand: PreparedHand
    prepared_object: PreparedObject
    physics: Simulation
    settings: GraspSettings
    plan: Planner

    def attempt(self, rng: np.random.Generator) -> Attempt | None:
        """Make one grasp, which depends on the search and `rng` alone; None without a plan."""
        posture = self.plan(rng)
        return None if posture is None else self._close(*posture)

    def _close(self, pose: NDArray[np.float64], target: NDArray[np.float64]) -> Attempt:
        hand, settings = self.prepared_hand.hand, self.settings
        start = self._pregrasp(pose, target)
        angles, rests = self.physics.settle(pose, start, target, max_steps=settings.settle_steps, resting_speed=RESTING_SPEED)
        frames = forward_kinematics(hand, pose, angles)
        poses = sensor_poses_from_links(hand, frames)
        contacts = []
        for sensor_pose, sensor in zip(poses, self.prepared_hand.sensors, strict=True):
            depth = ray_depth(self.prepared_object.faces, sensor_pose, sensor)
            contacts.append(contact_from_depth(depth, sensor_pose, sensor) if touch_success(depth, sensor) else None)
        squeeze = pregrasp_angles(hand, angles, [-settings.squeeze])[0]
        penetration = penetration_depth(self.prepared_object.field, self.prepared_hand.spheres, frames)
        fault = None
        if not rests:
            fault = f"fingers still move after {settings.settle_steps} steps (simulate-grasps.settle_steps)"
        elif not ((angles >= hand.lower) & (angles <= hand.upper)).all():
            fault = "a joint is pushed beyond its limit"
        elif hand_gap(hand, self.prepared_hand.ik.boxes, frames) < 0:
            fault = "links of the hand overlap"
        elif penetration > settings.penetration_limit:
            limit = 1e3 * settings.penetration_limit
            fault = f"a rigid link is more than {limit:g} mm inside the object (simulate-grasps.penetration_limit)"
        return Attempt(Grasp(pose, start, angles, squeeze, poses, contacts), penetration, fault)

    def _pregrasp(self, pose: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the joint angles from which the fingers close: each finger is drawn back as far as there is room behind it."""
        hand, ik = self.prepared_hand.hand, self.prepared_hand.ik
        postures = pregrasp_angles(hand, target, [OPENING, OPENING / 2, 0.0])
        clear = finger_clearance(self.prepared_object.field, ik.fingers, forward_kinematics(hand, pose, postures), floor=0.0) >= 0  # (3, S)
        start = target.copy()
        for s, finger in enumerate(hand.fingers):
            if clear[:, s].any():
                start[list(finger.joints)] = postures[clear[:, s].argmax()][list(finger.joints)]
        fits = hand_gap(hand, ik.boxes, forward_kinematics(hand, pose, start)) >= 0
        return start if fits else target

    def closure(self, grasp: Grasp) -> float:
        """Compute the margin of force closure."""
        points = self.prepared_object.points
        size = float(length(points.max(axis=0) - points.min(axis=0))) / 2
        contacts = [contact for contact in grasp.contacts if contact]
        return closure_margin(contacts, friction=self.prepared_hand.hand.friction, size=size)

    def score(self, grasp: Grasp) -> tuple[float, ...]:
        """Score a grasp by the setting `prefer`; the greatest is best."""
        touches = int(grasp.touched.sum())
        match self.settings.prefer:
            case "touches":
                return (touches,)
            case "area":
                return (float(grasp.contact_area.sum()),)
            case "closure":
                return (self.closure(grasp), touches)

    def keep_best(self, kept: list[Attempt], attempt: Attempt) -> list[Attempt]:  # best first, the earlier of equals first
        """Add a sound grasp to the best ones so far, those that hold first, and keep as many as the settings ask for."""
        best = sorted([*kept, attempt], key=lambda item: (item.holds, *self.score(item.grasp)), reverse=True)  # stable even so
        return best[: self.settings.grasps]
