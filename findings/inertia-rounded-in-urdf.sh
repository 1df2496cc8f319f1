#!/bin/sh
# PyBullet sets a link's inertia to zero, and MuJoCo to a ball's, if rounding breaks the triangle inequality by 0.05 %.
#
# One expects: a thin plate with moments of 1, 1 and 2 g m² may be rounded to 1, 1 and 2.001, and moves as it did: the largest moment is cut, the
#     others raised, or the file refused.
# What happens: PyBullet (URDF_USE_INERTIA_FROM_FILE) loads 0, 0, 0 and prints a warning. MuJoCo refuses the file and names `balanceinertia`;
#     with that, all three moments become their mean, which is 33 % too large or too small. The same for 0.05 % and for 400 %.
# Whom it hurts: exporters write few digits, and flat links of robot hands lie on the limit. A link without inertia spins as its joint's friction
#     and armature let it; the same file behaves differently in both engines.
# Versions: pybullet 3.2.7, mujoco 4.0.0, numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pybullet==3.2.7 mujoco==4.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import pathlib

import mujoco
import numpy as np
import pybullet

URDF = """<robot name="r">{options}<link name="base"/><link name="plate"><inertial><mass value="1"/>
<inertia ixx="0.001" iyy="0.001" izz="{greatest}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/></joint></robot>"""
BALANCED = '<mujoco><compiler balanceinertia="true"/></mujoco>'

pybullet.connect(pybullet.DIRECT)
loaded = {}
for greatest in (0.002, 0.002001):
    path = pathlib.Path(f"plate-{greatest}.urdf")
    path.write_text(URDF.format(options="", greatest=greatest))
    body = pybullet.loadURDF(str(path), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    bullet = np.array(pybullet.getDynamicsInfo(body, 0)[2])
    balanced = mujoco.MjModel.from_xml_string(URDF.format(options=BALANCED, greatest=greatest)).body("plate").inertia
    try:
        plain = str(mujoco.MjModel.from_xml_string(path.read_text()).body("plate").inertia)
    except ValueError as error:
        plain = str(error).splitlines()[0]
    loaded[greatest] = bullet, np.sort(balanced)
    print(f"stated 0.001 0.001 {greatest}: PyBullet {bullet}, MuJoCo {plain}, with balanceinertia {balanced}")
(right, also), (zero, ball) = loaded.values()
expected = np.array([0.001, 0.001, 0.002])
raise SystemExit(not (np.allclose(right, expected) and np.allclose(also, expected) and not zero.any() and np.allclose(ball, 0.004001 / 3)))
END
