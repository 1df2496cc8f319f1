"""Compute tactile images in a PyBullet loop while a ball rolls over a moving sensor."""

import argparse
import time

import numpy as np
import pybullet
import trimesh

import vt_pipeline as vt

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("sensor", nargs="?", default="gel_16mm", help="name or file of a sensor; default: %(default)s")
parser.add_argument("steps", nargs="?", default=480, type=int, help="of the simulation; default: %(default)s")
parser.add_argument("--show", action="store_true", help="open a live window")
given = parser.parse_args()
sensor = vt.load_sensor(given.sensor)
mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.01)
ball = vt.load_object((mesh.vertices, mesh.faces))  # or the path of a mesh file

pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -9.81)
pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE))
body = pybullet.createMultiBody(0.01, pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.01), basePosition=[-0.004, 0, 0.011])
pybullet.resetBaseVelocity(body, linearVelocity=[0.008, 0, 0])

felt, spent, window = 0, 0.0, None
for step in range(given.steps):
    pybullet.stepSimulation()
    position, quaternion = pybullet.getBasePositionAndOrientation(body)
    ball_pose = np.eye(4)
    ball_pose[:3, :3], ball_pose[:3, 3] = np.reshape(pybullet.getMatrixFromQuaternion(quaternion), (3, 3)), position
    sensor_pose = np.eye(4)  # the gel faces up through the floor; the sensor sways
    sensor_pose[:3, 3] = 0.001 * np.sin(step / 50), 0, 0.001 - sensor.w
    began = time.perf_counter()
    touch = vt.touch(ball, sensor, sensor_pose, object_pose=ball_pose)
    spent += (time.perf_counter() - began) * (step > 0)  # skip the first call, which compiles
    felt += touch.success
    if given.show:
        import matplotlib.pyplot as plt

        window = window or plt.imshow(touch.image)
        window.set_data(touch.image)
        plt.pause(0.001)
pybullet.disconnect()
rate = f"{(given.steps - 1) / spent:.0f} tactile images per second of one core"
print(f"{given.steps} steps, {felt} of them touch; {rate}; last contact {1e6 * touch.contact_area:.1f} mm²")
