"""Simulate lifts of stored grasps for animations: the fingers close, the object is released, and physics moves both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.dataset.grasps import read_grasps
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.grasp_closure import measure_contact
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.grasp_tests import GRASP_TESTS
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.motion import Motion

CLOSING_SECONDS, CLOSING_FRAMES = 0.8, 9
"""s from the pre-grasp to the grasp, in which the object does not move, as in the stage."""
FALL = 0.1
"""m that the object may move before the lift ends: enough to see the fall, not only its start."""


@dataclass(frozen=True, eq=False)
class Lift:
    """The lift of a grasp.

    Attributes
    ----------
    times
        (T,) s.
    joint_angles
        (T, J) rad.
    object_motion
        (T, 4, 4) from where the object was to where it is, world, m.
    held
        Whether it passes the lift of `GRASP_TESTS`.
    note
        Description of what happened.
    """

    times: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    object_motion: NDArray[np.float64]
    held: bool
    note: str


def lifts(test: HoldTest, surface: Mapping[str, np.ndarray], grasps: Mapping[str, np.ndarray], sensors: Sequence[Sensor]) -> list[Lift]:
    """Repeat the lift of an object's grasps, given by its rows, with the sensors that the hand wears.

    Returns
    -------
    One lift per grasp; none of rows that have no squeeze.

    Notes
    -----
    Each begins with a newly loaded object, so that it is the same every time. The stage tests one grasp after the other, and PyBullet
    remembers contacts (`HoldTest.hold`): of 100 grasps about two end differently here than `held` says.
    """
    if "squeeze_angles" not in set(grasps):
        return []
    mesh, points = read_mesh(surface), surface["points"].astype(np.float64)
    results = []
    faces = box_faces(mesh.triangles)
    for grasp in read_grasps(grasps):
        sites = zip(grasp.sensor_pose, sensors, grasp.touched, strict=True)
        contacts = [measure_contact(faces, pose, sensor) if touches else None for pose, sensor, touches in sites]
        grasp = replace(grasp, contacts=contacts)  # with the depths of the contacts, which are not stored
        test.load(mesh, points)
        results.append(_lift(grasp, test.hold(grasp, limit=FALL)))
    return results


def _lift(grasp: Grasp, motion: Motion) -> Lift:
    """Put the closing before the motion, and cut the motion at the first number that is not finite."""
    finite = np.isfinite(np.column_stack([motion.poses, motion.joint_angles])).all(axis=1)
    count = int(finite.argmin()) if not finite.all() else len(motion.poses)
    poses = motion.poses[:count]
    share = np.linspace(0, 1, CLOSING_FRAMES)[:-1, None]
    closing = (1 - share) * grasp.pregrasp_angles + share * grasp.joint_angles
    moved = np.tile(np.eye(4), (count, 1, 1))
    moved[:, :3, :3] = Rotation.from_quat(poses[:, 3:]).as_matrix()
    moved[:, :3, 3] = poses[:, :3] - np.einsum("nij,j->ni", moved[:, :3, :3], poses[0, :3])
    still = np.tile(np.eye(4), (len(closing), 1, 1))
    held = GRASP_TESTS["lift"].passes(motion)
    seconds = motion.interval * (count - 1)
    description = (
        f"moves {1e3 * motion.moved:.1f} mm and turns {np.rad2deg(motion.turned):.1f}°" if np.isfinite(motion.moved) else "flies away"
    )
    return Lift(
        times=np.concatenate([CLOSING_SECONDS * share[:, 0], CLOSING_SECONDS + motion.interval * np.arange(count)]),
        joint_angles=np.concatenate([closing, motion.joint_angles[:count]]),
        object_motion=np.concatenate([still, moved]),
        held=held,
        note=f"It {'stays' if held else 'slips'}: it {description} in {seconds:.2f} s.",
    )
