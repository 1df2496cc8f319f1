"""Plans of grasps: as many touches as possible (supplement 1.3), or contacts that carry the object."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from pipeline.kernels.arrays import Array, Indices
from pipeline.kernels.geometry.transforms import compose, invert_pose
from pipeline.kernels.hand.distance_field import finger_clearance, gel_contact, gel_probes, near_gaps
from pipeline.kernels.hand.grasp import contact_from_depth
from pipeline.kernels.hand.grasp_ik import GraspChoices, fingers_fit, grasp_ik
from pipeline.kernels.hand.grid_loops import gaps
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.load_residual import NO_SUPPORT, Support, best_supporting_grasp
from pipeline.kernels.hand.pinches import WIDTH_STEP, OpposedPostures, antipodal_points, central_weights
from pipeline.kernels.hand.pregrasp import frame_along, tangent_palm_pose
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import resample_longer_side
from stages.simulate_grasps.prepare import CLEARANCE, PreparedHand, PreparedObject
from stages.simulate_grasps.stage import GraspSettings

MAX_POSES = 40  # draws of palm point, distance and rotation per plan; a draw at which the hand would be in the object is repeated
MAX_SEARCHES = 3  # poses per plan for which the inverse kinematics may fail before the plan is given up
DRAWS = 256  # poses on opposed points drawn at once; one that has room is chosen among them
MAX_DRAWS = 4  # times that `DRAWS` poses are drawn; then a pose is drawn as for touches
FINGER_ROOM = -0.003  # m by which the two fingers may overlap the object in a drawn posture: the inverse kinematics corrects it
GEL_DISTANCE = 0.002  # m, largest distance of their gels from the object in a drawn posture
PLANNED_PIXELS = 100  # along the longer side of a gel whose contacts are evaluated
WEIGHED_CHOICES = 128  # most choices of fingers' postures whose contacts are evaluated
BATCHES = (1, 8, 32)  # choices after which the evaluation checks whether the best one can still be surpassed
Posture = tuple[Array, Array]  # a hand's pose (4, 4) and joint angles (J,)


@dataclass
class TouchPlanner:
    """Plan grasps of one object: a palm tangent to it at random, fingers that touch it where they can."""

    prepared_hand: PreparedHand
    prepared_object: PreparedObject
    settings: GraspSettings

    def __call__(self, rng: np.random.Generator) -> Posture | None:
        """Plan a posture in which gels press into the object; None where the hand has no room around it."""
        for pose in islice(self.poses_with_room(rng), MAX_SEARCHES):
            choices = self.solve(pose, rng)
            if len(choices.picks):
                return pose, choices.joint_angles(0)
        return None

    def poses_with_room(self, rng: np.random.Generator) -> Iterator[Array]:
        """Draw poses (4, 4), the palm tangent at a random surface point, at a random distance and turned; yield those with room for all."""
        hand, surface, palm = self.prepared_hand, self.prepared_object, self.prepared_hand.palm_spheres
        for _ in range(MAX_POSES):
            index = rng.integers(len(surface.points))
            distance = rng.uniform(self.settings.least_distance, self.settings.greatest_distance)
            angle = rng.uniform(0, 2 * np.pi)
            pose = tangent_palm_pose(hand.hand, surface.points[index], surface.normals[index], distance=distance, angle=angle)
            palm_gaps = near_gaps(surface.field, palm, forward_kinematics(hand.hand, pose, hand.hand.lower), CLEARANCE)
            if (palm_gaps >= CLEARANCE).all() and fingers_fit(hand.ik, surface.field, pose):
                yield pose

    def solve(self, pose: Array, rng: np.random.Generator, start: Array | None = None) -> GraspChoices:
        """Solve for the fingers of a hand at a pose (4, 4), from postures that may include a start (J,)."""
        field, rounds = self.prepared_object.field, self.settings.ik_refinements
        return grasp_ik(self.prepared_hand.ik, field, pose, rounds=rounds, rng=rng, start=start)


class HoldPlanner(TouchPlanner):
    """Plan grasps of one object, each the best of a few, that hold it whichever way gravity points: two gels on opposed points."""

    def __init__(
        self,
        prepared_hand: PreparedHand,
        prepared_object: PreparedObject,
        settings: GraspSettings,
        postures: OpposedPostures,  # of the hand
        rng: np.random.Generator,  # of the rays that search opposed points
    ) -> None:
        super().__init__(prepared_hand, prepared_object, settings)
        field, points, normals = prepared_object.field, prepared_object.points, prepared_object.normals
        widest, friction = float(postures.width.max(initial=0.0)) + WIDTH_STEP, prepared_hand.hand.friction
        self.postures, self.pairs = postures, antipodal_points(field, points, normals, friction=friction, widest=widest, rng=rng)
        worn, fewer = prepared_hand.sensors, PLANNED_PIXELS
        self.sensors = [sensor if max(sensor.shape) <= fewer else resample_longer_side(sensor, fewer) for sensor in worn]
        self.centre = points.mean(axis=0)  # of the mass, which is spread evenly over the exterior
        self.weights = central_weights(self.pairs, self.centre, spread=settings.spread) if len(self.pairs.width) else np.empty(0)

    def __call__(self, rng: np.random.Generator) -> Posture | None:
        """Plan a few postures and return the one that carries the object best; None where the hand has no room around it."""
        best, plan = NO_SUPPORT, None
        for _ in range(self.settings.plans):
            if (draw := self._draw_pose(rng)) is None:
                continue
            pose, start = draw
            choices = self.solve(pose, rng, start)
            number, best = self._lightest(choices, best)
            if number >= 0:
                plan = pose, choices.joint_angles(number)
            if self._is_perfect(best):
                break
        return plan

    def _draw_pose(self, rng: np.random.Generator) -> tuple[Array, Array | None] | None:
        """Draw a pose and an opposed posture with both gels at the object, and room for palm and fingers; else a pose as for touches."""
        for _ in range(MAX_DRAWS if len(self.weights) else 0):
            poses, rows = self._draw(rng)
            usable = self._usable(poses, rows) if len(rows) else rows
            if len(usable):
                draw = usable[rng.integers(len(usable))]
                return poses[draw], self.postures.joint_angles[rows[draw]]
        pose = next(self.poses_with_room(rng), None)
        return None if pose is None else (pose, None)

    def _draw(self, rng: np.random.Generator) -> tuple[Array, Indices]:
        """Draw poses (N, 4, 4) of the hand and rows (N,) of its opposed postures, set on opposed points of their width."""
        postures = self.postures
        pair = rng.choice(len(self.weights), DRAWS, p=self.weights)
        width = self.pairs.width[pair]
        first, last = (np.searchsorted(postures.width, width + side * WIDTH_STEP) for side in (-1, 1))
        rows = first + np.floor(rng.random(DRAWS) * (last - first)).astype(np.intp)
        swapped, turn = rng.integers(2, size=DRAWS), rng.uniform(0, 2 * np.pi, DRAWS)
        has_posture = last > first
        pair, rows = pair[has_posture], rows[has_posture]
        axis = self.pairs.axis[pair] * np.where(swapped, -1.0, 1.0)[has_posture, None]
        grips = frame_along(postures.axis[rows], np.zeros(len(rows)), postures.centre[rows])
        return compose(frame_along(axis, turn[has_posture], self.pairs.centre[pair]), invert_pose(grips)), rows

    def _usable(self, poses: Array, rows: Indices) -> Indices:
        """Select the draws (K,) at which palm and both fingers have room, and both gels are at the object."""
        hand, ik, field, sensors = self.prepared_hand.hand, self.prepared_hand.ik, self.prepared_object.field, self.postures.sensors[rows]
        frames = compose(poses[:, None], forward_kinematics(hand, np.eye(4), self.postures.joint_angles[rows]))
        at_object = np.abs(gel_contact(field, gel_probes(hand, ik.gels, frames))[0]) <= GEL_DISTANCE
        draws = np.flatnonzero(np.take_along_axis(at_object, sensors, axis=1).all(axis=1))
        draws = draws[gaps(field.grid, frames[draws], self.prepared_hand.palm_spheres.single, np.float32(CLEARANCE)) >= CLEARANCE]
        clear = finger_clearance(field, ik.fingers, frames[draws], floor=FINGER_ROOM) >= FINGER_ROOM
        clear = np.column_stack([clear, np.ones(len(draws), bool)])  # the palm is the last
        return draws[np.take_along_axis(clear, hand.sensor_fingers[sensors[draws]], axis=1).all(axis=1)]

    def _lightest(self, choices: GraspChoices, best: Support) -> tuple[int, Support]:
        """Select the choice that carries the object best: its number and support; -1 and `best` if none surpasses `best`."""
        hand, number = self.prepared_hand.hand, -1
        owners = hand.sensor_fingers
        picks = choices.picks[:WEIGHED_CHOICES]
        options = np.where(owners >= 0, picks[:, owners], 0)  # (N, S)
        points, normals = np.zeros((2, len(choices.options), len(owners), 3))
        touching, measured = np.zeros((2, *points.shape[:2]), bool)
        poses = sensor_poses_from_links(hand, choices.frames)
        for batch in np.split(np.arange(len(picks)), [end for end in BATCHES if end < len(picks)]):
            of_batch = options[batch], np.arange(len(owners))
            needed = np.zeros_like(measured)
            needed[of_batch] = True
            for option, sensor in np.argwhere(needed & ~measured).tolist():
                pose, worn = poses[option, sensor], self.sensors[sensor]
                contact = contact_from_depth(ray_depth(self.prepared_object.faces, pose, worn), pose, worn)
                if contact is not None:
                    points[option, sensor], normals[option, sensor] = contact.point - self.centre, contact.normal
                    touching[option, sensor] = True
            measured |= needed
            row, best = best_supporting_grasp(points[of_batch], normals[of_batch], touching[of_batch], hand.friction, best)
            if row >= 0:
                number = int(batch[row])
            if self._is_perfect(best):
                break
        return number, best

    def _is_perfect(self, support: Support) -> bool:
        """Check whether no plan can surpass a support."""
        return support == (0, len(self.prepared_hand.sensors))
