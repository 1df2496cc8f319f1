"""Measure grasps of one object: contacts, force closure, penetration, and whether each holds."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.dataset.grasps import grasp_row
from pipeline.kernels.arrays import Array, Array32
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.distance_field import penetration_depth
from pipeline.kernels.hand.gel_balance import close_to_torque
from pipeline.kernels.hand.grasp import Grasp, closure_margin, contact_from_depth
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.physics.hold_test import DOWN, HOLD_TESTS, HoldTest, is_held
from pipeline.store.rows import Row
from stages.simulate_grasps.prepare import MeasuredHand, PreparedObject
from stages.simulate_grasps.stage import HandSettings


@dataclass(frozen=True, eq=False)
class Attempt:
    """A grasp as simulated."""

    grasp: Grasp
    penetration: float  # m, of the deepest rigid point in the object
    fault: str | None  # why it cannot be kept: it moves, leaves its joint limits, or penetrates itself or the object
    holds: bool = False  # it passed the hold test of a hold search
    motions: Array32 = field(default_factory=lambda: np.empty((0, 2), np.float32))  # (D, 2) m, m/s, of the object in that test


class MeasuredGrasps:
    """Measures the grasps of one object, which the hold test has loaded."""

    def __init__(self, hand: MeasuredHand, prepared_object: PreparedObject, settings: HandSettings, test: HoldTest | None) -> None:
        self.measured_hand, self.object, self.limits, self.test = hand, prepared_object, settings, test

    def measure(
        self,
        pose: Array,  # (4, 4) root link to world, m
        start: Array,  # (J,) from which the fingers close
        angles: Array,  # (J,) at which they rest
        squeeze: Array | None = None,  # (J,) by default `squeeze` m further along the sensors' normals
    ) -> Attempt:
        """Find the contacts of a grasp, and how deep the hand is in the object."""
        hand = self.measured_hand
        frames = forward_kinematics(hand.hand, pose, angles)
        poses = sensor_poses_from_links(hand.hand, frames)
        contacts = []
        for sensor_pose, sensor in zip(poses, hand.sensors, strict=True):
            depth = ray_depth(self.object.faces, sensor_pose, sensor)
            contacts.append(contact_from_depth(depth, sensor_pose, sensor) if touch_success(depth, sensor) else None)
        if squeeze is None:
            squeeze = pregrasp_angles(hand.hand, angles, [-self.limits.squeeze])[0]
        penetration, fault = penetration_depth(self.object.field, hand.spheres, frames), None
        if penetration > self.limits.penetration_limit:
            limit = 1e3 * self.limits.penetration_limit
            fault = f"a rigid link is more than {limit:g} mm inside the object ({self.limits.stage}.penetration_limit)"
        return Attempt(Grasp(pose, start, angles, squeeze, poses, contacts), penetration, fault)

    def closed(self, pose: Array, start: Array, angles: Array) -> tuple[Array, bool]:
        """Let the fingers that close from one posture (J,) to another stop where elastic gels take all of the motors' torque.

        Also return whether there is such a posture.
        """
        hand = self.measured_hand
        if any(sensor.gel is None for sensor in hand.sensors):
            return angles, True
        return close_to_torque(hand.hand, hand.sensors, self.object.faces, pose, start, angles)

    def row(self, kept: Sequence[Attempt]) -> Row:
        """Make the part of an object's row that describes these grasps."""
        return {
            **grasp_row([attempt.grasp for attempt in kept]),
            "closure": np.array([self.closure(attempt.grasp) for attempt in kept], np.float32),
            "penetration": np.array([attempt.penetration for attempt in kept], np.float32),
            **self._held(kept),
        }

    def closure(self, grasp: Grasp) -> float:
        """Compute the margin of force closure."""
        size = float(length(np.ptp(self.object.points, axis=0))) / 2
        return closure_margin([contact for contact in grasp.contacts if contact], friction=self.measured_hand.hand.friction, size=size)

    def _measure(self, grasp: Grasp, *, to_end: bool) -> tuple[Array32, bool]:
        """Measure how far, m, and how fast, m/s, the object moved at the end of the hold test in each direction, (D, 2).

        Unless `to_end`, the first direction in which the grasp does not hold is the last. Also return whether it holds in all; without a
        test each grasp does.
        """
        if self.test is None:
            return np.empty((0, 2), np.float32), True
        motions, holds = [], True
        for acceleration in HOLD_TESTS[self.limits.test]:
            motion = self.test.hold(grasp, acceleration=acceleration)
            motions.append(np.array([motion.moved, motion.speed], np.float32))
            holds &= bool(is_held(*motions[-1]))
            if not (holds or to_end):
                break
        return np.stack(motions), holds

    def _held(self, kept: Sequence[Attempt]) -> Row:
        """Tell which grasps hold, and how the object moved; those that have not passed all directions are tested in each of them."""
        if self.test is None:
            return {}
        motions = [attempt.motions if attempt.holds else self._measure(attempt.grasp, to_end=True)[0] for attempt in kept]
        distance, speed = np.moveaxis(np.stack(motions), -1, 0)
        held = is_held(distance, speed)
        row = {"held": held[:, HOLD_TESTS[self.limits.test].index(DOWN)], "hold_distance": distance, "hold_speed": speed}
        return row | ({"held_directions": held} if self.limits.test == "six" else {})
