"""Read poses from a running MuJoCo model and compute tactile images, depth and force per step: two fingertips lift an egg."""

import argparse
import time

import mujoco
import numpy as np

import vt_pipeline as vt

# Each finger has a site, which is the sensor's frame, and a plate on a spring that collides in place of the soft gel.
MODEL = """<mujoco><compiler boundmass=".05" boundinertia="1e-5"/>
<option timestep=".001" cone="elliptic" impratio="10"/><default><geom condim="4" solref=".003 1"/></default>
<asset><mesh name="egg" builtin="supersphere" params="128 1 1" scale=".02 .03 .02"/></asset>
<worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .02"><freejoint/><geom name="egg" type="mesh" mesh="egg" mass=".05"/></body>
  <body pos="0 0 .02"><joint name="lift" type="slide" axis="0 0 1" damping="20"/>
    <replicate count="2" euler="0 0 180">
      <body pos="-.03 0 0"><joint name="finger" type="slide" axis="1 0 0" damping="20"/><site name="sensor" zaxis="1 0 0"/>
        <body><joint type="slide" axis="1 0 0" stiffness="6400" damping="5"/>
          <geom type="box" size=".002 .01 .008" pos=".002 0 0" mass=".02"/></body></body>
    </replicate></body>
</worldbody>
<actuator><position joint="lift" kp="5000"/><motor joint="finger0"/><motor joint="finger1"/></actuator></mujoco>"""
parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("steps", nargs="?", default=100, type=int, help="of 20 ms; default: %(default)s")
steps = parser.parse_args().steps
model = mujoco.MjModel.from_xml_string(MODEL)  # or from_xml_path
data = mujoco.MjData(model)
sensor = vt.load_sensor("gelsight_mini")
mesh = model.mesh("egg")  # as compiled, not as in a file: MuJoCo moves meshes to their centre and principal axes
egg = vt.load_object((model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]], model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]))


def frame(part):
    """Return the pose (4, 4) in the world of a geom or site."""
    return np.vstack([np.column_stack([part.xmat.reshape(3, 3), part.xpos]), [0, 0, 0, 1]])


spent = 0.0
for step in range(steps):
    data.ctrl[:] = max(0.1 * step / steps - 0.05, 0), 3, 3  # m, N, N
    mujoco.mj_step(model, data, nstep=20)
    began = time.process_time()
    touches = [vt.touch(egg, sensor, frame(data.site(name)), object_pose=frame(data.geom("egg"))) for name in ("sensor0", "sensor1")]
    forces = [touch.force for touch in touches]  # N; touch.image, touch.depth, touch.pressure are arrays of the sensor's pixels
    spent += (time.process_time() - began) * (step > 0)  # skip the first step, which compiles
rate = f"{2 * (steps - 1) / spent:.0f} frames of {sensor.rows} x {sensor.cols} pixels per second of one core"
print(f"{rate}; the egg is {1e3 * data.geom('egg').xpos[2]:.0f} mm above the floor, held by {forces[0]:.1f} and {forces[1]:.1f} N")
