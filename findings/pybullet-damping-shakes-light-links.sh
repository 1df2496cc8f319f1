#!/bin/sh
# PyBullet's joint damping makes light links shake without end.
#
# One expects: damping of a joint takes energy out of it, whatever its size; MuJoCo's does.
# What happens: PyBullet adds the damping torque explicitly. Where damping × step > 2 × inertia (0.001 N m s/rad and a fingertip of 1e-6 kg m²,
#     at 240 steps per second) each step turns the motion round and enlarges it, up to the greatest speed; nothing is said.
# Whom it hurts: hands with the damping that MJCF files state for their light links (0.01 to 0.2 N m s/rad): their fingers never rest.
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
import pybullet

MASS = '<inertial><mass value="0.01"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>'
FINGER = (
    f'<robot name="f"><link name="palm">{MASS}</link><link name="tip">{MASS}</link><joint name="j" type="continuous">'
    '<parent link="palm"/><child link="tip"/><axis xyz="1 0 0"/><dynamics damping="DAMPING" friction="0"/></joint></robot>'
)
STEPS, SPEED = 60, 0.1  # of 1/240 s; rad/s at the start
pybullet.connect(pybullet.DIRECT)


def speeds(damping):  # rad/s after the steps, in PyBullet and MuJoCo
    path = pathlib.Path(f"finger-{damping}.urdf")  # a name of its own: PyBullet keeps files by name
    path.write_text(FINGER.replace("DAMPING", str(damping)))
    finger = pybullet.loadURDF(str(path), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    pybullet.setJointMotorControl2(finger, 0, pybullet.VELOCITY_CONTROL, force=0)
    pybullet.resetJointState(finger, 0, 0, SPEED)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 1 / 240
    data = mujoco.MjData(model)
    data.qvel[0] = SPEED
    for _ in range(STEPS):
        pybullet.stepSimulation()
        mujoco.mj_step(model, data)
    return abs(pybullet.getJointState(finger, 0)[1]), abs(float(data.qvel[0]))


shakes = []
for damping in (0.0001, 0.001, 0.1):
    bullet, other = speeds(damping)
    shakes.append((bullet > SPEED, other > SPEED))
    print(f"damping {damping} N m s/rad: from {SPEED} rad/s to {bullet:.2g} in PyBullet, {other:.2g} in MuJoCo")
raise SystemExit(shakes != [(False, False), (True, False), (True, False)])
END
