#!/bin/sh
# MuJoCo and PyBullet read the capsules of URDF 1.1 and ignore its rotations.
#
# One expects: an engine that reads `<capsule>`, which came with URDF 1.1 (urdfdom 5.1), also reads `<origin quat_xyzw="...">` of the same version, or
#     refuses it as it refuses other attributes that it does not know.
# What happens: both load the file without a word and leave the capsule along z; the file turns it by 90 degrees about x, so that it lies along y.
# Whom it hurts: hands exported as URDF 1.1 get fingers that point somewhere else; grasps close on air, in both engines alike.
# Versions: mujoco 3.17.0, pybullet 3.2.7, numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==3.17.0 pybullet==3.2.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import pathlib

import mujoco
import numpy as np
import pybullet

LINK = (
    '<robot name="r" version="1.1"><link name="finger"><inertial><mass value="1"/>'
    '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><origin xyz="0 0 0" ROTATION/><geometry><capsule radius="0.006" length="0.05"/></geometry></collision></link></robot>'
)
along_y = {}
pybullet.connect(pybullet.DIRECT)
for name, rotation in (("rpy", 'rpy="1.5707963 0 0"'), ("quat_xyzw", 'quat_xyzw="0.70710678 0 0 0.70710678"')):
    pathlib.Path(f"{name}.urdf").write_text(LINK.replace("ROTATION", rotation))
    low, high = pybullet.getAABB(pybullet.loadURDF(f"{name}.urdf", flags=pybullet.URDF_USE_INERTIA_FROM_FILE))
    sides = np.subtract(high, low)
    model = mujoco.MjModel.from_xml_path(f"{name}.urdf")
    axis = np.zeros(9)
    mujoco.mju_quat2Mat(axis, model.geom_quat[0])
    along_y[name] = sides[1] > 0.05, abs(axis[5]) > 0.99
    print(f"{name}: PyBullet's box {sides.round(3)} m; MuJoCo's capsule along {axis[[2, 5, 8]].round(3)}")
raise SystemExit(along_y != {"rpy": (True, True), "quat_xyzw": (False, False)})
END
