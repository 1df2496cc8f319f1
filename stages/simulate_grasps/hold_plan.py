"""Plans of grasps that hold: two gels on opposed points of the surface, and fingers whose contacts carry the object's weight."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import compose, invert_pose
from pipeline.kernels.hand.distance_field import finger_clearance, gel_contact, gel_probes
from pipeline.kernels.hand.grasp import measure_contact
from pipeline.kernels.hand.grasp_ik import GraspChoices, grasp_ik
from pipeline.kernels.hand.grid_loops import gaps
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.load_residual import NO_SUPPORT, Support, best_supporting_grasp
from pipeline.kernels.hand.pinches import WIDTH_STEP, AntipodalPoints, OpposedPostures, antipodal_points, central_weights, opposed_postures
from pipeline.kernels.hand.pregrasp import frame_along
from stages.simulate_grasps.grasp_search import Posture
from stages.simulate_grasps.prepare import CLEARANCE, PreparedHand, PreparedObject
from stages.simulate_grasps.stage import GraspSettings
from stages.simulate_grasps.touch_plan import TouchPlanner

DRAWS = 256
"""Poses drawn at once; one that has room is chosen among them."""
MAX_DRAWS = 4
"""Most times that `DRAWS` poses are drawn; then a pose is drawn as for touches."""
FINGER_ROOM = -0.003
"""m by which the two fingers may overlap the object in a drawn posture: the inverse kinematics corrects it."""
GEL_DISTANCE = 0.002
"""m, largest distance of their gels from the object in a drawn posture."""
WEIGHED_CHOICES = 128
"""Most choices of fingers' postures whose contacts are evaluated."""
BATCHES = (1, 8, 32)
"""Choices after which the evaluation checks whether the best one can still be surpassed."""


@dataclass(frozen=True, eq=False)
class Pinches:
    """A hand's opposed postures; frames are in the root link's frame, m."""

    postures: OpposedPostures  # P
    grips: NDArray[np.float64]  # (P, 4, 4)
    frames: NDArray[np.float64]  # (P, L, 4, 4) of the links
    fingers: NDArray[np.intp]  # (P, 2)


def prepare_pinches(prepared_hand: PreparedHand) -> Pinches:
    """Search a hand's opposed postures, once per session."""
    hand, postures = prepared_hand.hand, opposed_postures(prepared_hand.ik)
    grips = frame_along(postures.axis, np.zeros(len(postures.axis)), postures.centre)
    return Pinches(postures, grips, forward_kinematics(hand, np.eye(4), postures.joint_angles), hand.sensor_fingers[postures.sensors])


@dataclass(frozen=True, eq=False)
class HoldPlanner:
    """Plan grasps of one object, each the best of a few, that hold it whichever way gravity points."""

    prepared_hand: PreparedHand
    prepared_object: PreparedObject
    settings: GraspSettings
    pinches: Pinches
    pairs: AntipodalPoints
    weights: NDArray[np.float64]

    @classmethod
    def of_object(
        cls, hand: PreparedHand, prepared_object: PreparedObject, settings: GraspSettings, pinches: Pinches, rng: np.random.Generator
    ) -> "HoldPlanner":
        """Search the object's opposed points; `rng` draws rays."""
        widest = float(pinches.postures.width.max(initial=0.0)) + WIDTH_STEP
        pairs = antipodal_points(
            prepared_object.field, prepared_object.points, prepared_object.normals, friction=hand.hand.friction, widest=widest, rng=rng
        )
        weights = central_weights(pairs, prepared_object.centre, spread=settings.spread) if len(pairs.width) else np.empty(0)
        return cls(hand, prepared_object, settings, pinches, pairs, weights)

    def __call__(self, rng: np.random.Generator) -> Posture | None:
        """Plan a few postures and return the best; None where the hand has no room around the object."""
        best, plan = NO_SUPPORT, None
        for _ in range(self.settings.plans):
            if (draw := self._draw_choices(rng)) is None:
                continue
            pose, choices = draw
            number, best = self._lightest(choices, best)
            if number >= 0:
                plan = pose, choices.joint_angles(number)
            if self._is_perfect(best):
                break
        return plan

    def _draw_choices(self, rng: np.random.Generator) -> tuple[NDArray[np.float64], GraspChoices] | None:
        """Draw a pose (4, 4) and solve for the fingers; None where they have no room."""
        pose, start = self._draw_opposed_pose(rng)
        if pose is None:
            pose = next(TouchPlanner(self.prepared_hand, self.prepared_object, self.settings).poses_with_room(rng), None)
        if pose is None:
            return None
        field, rounds = self.prepared_object.field, self.settings.ik_refinements
        return pose, grasp_ik(self.prepared_hand.ik, field, pose, rounds=rounds, rng=rng, start=start)

    def _draw_opposed_pose(self, rng: np.random.Generator) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """Draw a pose (4, 4) at which an opposed posture (J,) has both gels at the object and room for palm and fingers; None for none."""
        for _ in range(MAX_DRAWS if len(self.weights) else 0):
            poses, rows = self._draw(rng)
            usable = self._usable(poses, rows) if len(rows) else rows
            if len(usable):
                draw = usable[rng.integers(len(usable))]
                return poses[draw], self.pinches.postures.joint_angles[rows[draw]]
        return None, None

    def _draw(self, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Draw poses (N, 4, 4) of the hand and rows (N,) of its opposed postures, set on opposed points of their width."""
        postures = self.pinches.postures
        pair = rng.choice(len(self.weights), DRAWS, p=self.weights)
        width = self.pairs.width[pair]
        first, last = (np.searchsorted(postures.width, width + side * WIDTH_STEP) for side in (-1, 1))
        rows = first + np.floor(rng.random(DRAWS) * (last - first)).astype(np.intp)
        swapped, turn = rng.integers(2, size=DRAWS), rng.uniform(0, 2 * np.pi, DRAWS)
        has_posture = last > first
        pair, rows = pair[has_posture], rows[has_posture]
        axis = self.pairs.axis[pair] * np.where(swapped, -1.0, 1.0)[has_posture, None]
        return compose(frame_along(axis, turn[has_posture], self.pairs.centre[pair]), invert_pose(self.pinches.grips[rows])), rows

    def _usable(self, poses: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Select the draws (K,) at which palm and both fingers have room, and both gels are at the object."""
        hand, ik, field = self.prepared_hand.hand, self.prepared_hand.ik, self.prepared_object.field
        palm = self.prepared_hand.palm_spheres
        frames = compose(poses[:, None], self.pinches.frames[rows])
        has_room = gaps(field.grid, frames, palm.single, np.float32(CLEARANCE)) >= CLEARANCE
        clear = finger_clearance(field, ik.fingers, frames, floor=FINGER_ROOM) >= FINGER_ROOM
        clear = np.column_stack([clear, np.ones(len(rows), bool)])  # the palm is the last
        at_object = np.abs(gel_contact(field, gel_probes(hand, ik.fingers, frames))[0]) <= GEL_DISTANCE
        fingers, sensors = self.pinches.fingers[rows], self.pinches.postures.sensors[rows]
        fits = np.take_along_axis(clear, fingers, axis=1) & np.take_along_axis(at_object, sensors, axis=1)
        return np.flatnonzero(has_room & fits.all(axis=1))

    def _lightest(self, choices: GraspChoices, best: Support) -> tuple[int, Support]:
        """Select the choice that carries the object best: its number and load; -1 and `best` if none surpasses `best`."""
        hand, faces, number = self.prepared_hand.hand, self.prepared_object.faces, -1
        owners = hand.sensor_fingers
        picks = choices.picks[:WEIGHED_CHOICES]
        options = np.where(owners >= 0, picks[:, owners], 0)  # (N, S)
        points, normals = np.zeros((2, len(choices.options), len(owners), 3))
        touching = np.zeros(points.shape[:2], bool)
        measured = np.zeros(points.shape[:2], bool)
        poses = sensor_poses_from_links(hand, choices.frames)
        for batch in np.split(np.arange(len(picks)), [end for end in BATCHES if end < len(picks)]):
            of_batch = options[batch], np.arange(len(owners))
            needed = np.zeros_like(measured)
            needed[of_batch] = True
            for option, sensor in np.argwhere(needed & ~measured).tolist():
                contact = measure_contact(faces, poses[option, sensor], self.prepared_hand.sensors[sensor])
                if contact is not None:
                    points[option, sensor], normals[option, sensor] = contact.point - self.prepared_object.centre, contact.normal
                    touching[option, sensor] = True
            measured |= needed
            row, best = best_supporting_grasp(points[of_batch], normals[of_batch], touching[of_batch], hand.friction, best)
            if row >= 0:
                number = int(batch[row])
            if self._is_perfect(best):
                break
        return number, best

    def _is_perfect(self, load: Support) -> bool:
        """Check whether no plan can surpass a load."""
        return load == (0, len(self.prepared_hand.sensors))
