"""The grasps of a dataset as a robot or a physics engine takes them: postures from pre-grasp to squeeze, and contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.hand.grasp_closure import Contact, measure_contact
from pipeline.kernels.touch.ray_depth import box_faces
from pipeline.kernels.touch.sensor import Sensor


@dataclass(frozen=True, eq=False)
class StoredGrasp:
    """A grasp; if only the grasp is stored, all three postures are equal."""

    hand_pose: NDArray[np.float64]  # (4, 4) root link's frame to world, m
    pregrasp: NDArray[np.float64]  # (J,) rad (m of a joint that slides), before the fingers close
    joint_angles: NDArray[np.float64]  # (J,) rad or m, as the fingers rest
    squeeze: NDArray[np.float64]  # (J,) rad or m, what motors drive to
    contacts: Sequence[Contact | None]  # one per sensor, None where it does not touch


def read_grasps(
    grasps: Mapping[str, np.ndarray],  # the object's row
    surface: Mapping[str, np.ndarray],  # the object's row
    sensors: Sequence[Sensor],  # those that the hand wears
) -> list[StoredGrasp]:
    """Read an object's grasps from its rows of `grasps` and `surfaces`; contacts are measured again."""
    faces, stored = box_faces(read_mesh(surface).triangles), set(grasps)
    angles = grasps["joint_angles"]
    pregrasp, squeeze = (grasps[name] if name in stored else angles for name in ("pregrasp_angles", "squeeze_angles"))
    contacts = [
        [measure_contact(faces, pose, sensor) if touches else None for pose, sensor, touches in zip(poses, sensors, touched, strict=True)]
        for poses, touched in zip(grasps["sensor_pose"], grasps["touch_success"], strict=True)
    ]
    return [StoredGrasp(*grasp) for grasp in zip(grasps["hand_pose"], pregrasp, angles, squeeze, contacts, strict=True)]
