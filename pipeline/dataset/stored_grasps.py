"""The grasps of a dataset as a robot or a physics engine takes them: postures from pre-grasp to squeeze, and contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.hand.grasp_closure import Contact, measure_contact
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.sensor import Sensor


@dataclass(frozen=True, eq=False)
class StoredGrasp:
    """A grasp.

    Attributes
    ----------
    hand_pose
        (4, 4) root link's frame in the world, m.
    pregrasp, joint_angles, squeeze
        (J,) rad (m of a joint that slides): before the fingers close, as they rest, and what motors drive to. If only the grasp is
        stored, all three are equal.
    contacts
        One per sensor, None where it does not touch.
    """

    hand_pose: NDArray[np.float64]
    pregrasp: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    squeeze: NDArray[np.float64]
    contacts: Sequence[Contact | None]


def read_grasps(grasps: Mapping[str, np.ndarray], surface: Mapping[str, np.ndarray], sensors: Sequence[Sensor]) -> list[StoredGrasp]:
    """Read an object's grasps from its rows of `grasps` and `surfaces`; contacts are measured again.

    Parameters
    ----------
    grasps, surface
        The object's rows.
    sensors
        Those that the hand wears.
    """
    faces, stored = box_faces(read_mesh(surface).triangles), set(grasps)
    angles = grasps["joint_angles"]
    pregrasp, squeeze = (grasps[name] if name in stored else angles for name in ("pregrasp_angles", "squeeze_angles"))
    contacts = [
        [measure_contact(faces, pose, sensor) if touches else None for pose, sensor, touches in zip(poses, sensors, touched, strict=True)]
        for poses, touched in zip(grasps["sensor_pose"], grasps["touch_success"], strict=True)
    ]
    return [StoredGrasp(*grasp) for grasp in zip(grasps["hand_pose"], pregrasp, angles, squeeze, contacts, strict=True)]
