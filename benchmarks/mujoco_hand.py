"""A hand as MuJoCo's description of it, with a plate for each gel: of a URDF as we write it, of an MJCF as the file has it."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.formats.mjcf_files import import_mujoco, is_mjcf, read_spec
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_mjcf import urdf_spec
from pipeline.physics.hand_urdf import GEL_MASS, gel_name


def hand_spec(
    hand: Hand,
    sensors: Sequence[Sensor],  # of its mounts
    folder: Path,  # that meshes are written to
) -> Any:
    """Make MuJoCo's description of a hand whose root is fixed in the world, without motors."""
    return _spec_of_mjcf(hand, sensors) if is_mjcf(hand.model) else urdf_spec(hand, sensors, folder)


def _spec_of_mjcf(hand: Hand, sensors: Sequence[Sensor]) -> Any:
    """Take the root's body out of the file, without the joints that hold it, what moves joints, and what is bound to others."""
    mujoco, (whole, _) = import_mujoco(), read_spec(hand.model)
    ties = [equality for equality in whole.equalities if equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)]
    root = whole.body(hand.links[0].name)
    for element in (*whole.sensors, *whole.keys, *whole.actuators, *whole.pairs, *whole.excludes, *ties, *root.joints):
        whole.delete(element)
    spec = mujoco.MjSpec()
    with warnings.catch_warnings(action="ignore"):  # options of the file, such as its time step, do not count
        spec.worldbody.add_frame().attach_body(root, "", "")
        spec.assets = dict(whole.assets)
        spec.compile()  # it warns here, once
    for name, value in hand.frozen.items():
        lock = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=name)
        lock.data[:] = 0.0
        lock.data[0] = value - spec.joint(name).ref
    for number, (mount, sensor) in enumerate(zip(hand.sensors, sensors, strict=True)):
        turn = Rotation.from_matrix(mount.pose[:3, :3]).as_quat(scalar_first=True)
        gel = spec.body(hand.links[mount.link].name).add_body(name=gel_name(number), pos=mount.pose[:3, 3], quat=turn)
        gel.mass, gel.inertia, gel.ipos, gel.explicitinertial = GEL_MASS, np.full(3, 1e-6), np.zeros(3), True
        slide = {"type": mujoco.mjtJoint.mjJNT_SLIDE, "axis": [0, 0, 1], "range": [0, gel_top(sensor)], "limited": True}
        gel.add_joint(name=gel_name(number), **slide)
        half = [sensor.width / 2, sensor.height / 2, sensor.w / 2]
        gel.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=[0, 0, -sensor.w / 2])
    return spec
