"""Press a ball of 6 mm radius, slide and twist it, and lift off; print the forces, and write the images with dots as an animation."""

import argparse

import numpy as np
import trimesh
from PIL import Image

import vt_pipeline as vt

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("animation", nargs="?", default="slide.webp", help="WebP to write; default: %(default)s")
parser.add_argument("steps", nargs="?", default=60, type=int, help="of the path; default: %(default)s")
parser.add_argument("--friction", default=0.5, type=float, help="coefficient; default: %(default)s")
given = parser.parse_args()
sensor = vt.load_sensor("gelsight_mini")
mesh = trimesh.creation.icosphere(subdivisions=6, radius=0.006)
ball = vt.load_object((mesh.vertices, mesh.faces))

# The sensor is above the ball and faces down: its +z is the ball's -z, its +x the ball's +x.
time = np.linspace(0, 1, given.steps)
deep = np.interp(time, [0, 0.2, 0.9, 1], [-2e-5, 5e-4, 5e-4, -2e-5])  # m in the gel: press and, at the end, lift off
along = np.interp(time, [0.2, 0.55], [0, 5e-4])  # m along x
turn = np.interp(time, [0.55, 0.9], [0, 0.5])  # rad about the sensor's axis
poses = np.zeros((given.steps, 4, 4))
poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = np.cos(turn), -np.sin(turn), -np.sin(turn), -np.cos(turn)
poses[:, 2, 2], poses[:, 3, 3] = -1, 1
poses[:, 0, 3], poses[:, 2, 3] = along, 0.006 + sensor.w - deep

x, y = np.meshgrid(np.linspace(-0.009, 0.009, 10), np.linspace(-0.0065, 0.0065, 7))
dots = np.stack([x, y], axis=-1).reshape(-1, 2)  # printed on the gel, m from its middle
frames = []
print("time  normal N  along x N  torque mN·m  slipping")
for number, touch in enumerate(vt.slide(ball, sensor, poses, friction=given.friction)):
    frames.append(Image.fromarray(vt.markers(touch, dots).image))
    if number % max(1, given.steps // 12) == 0:
        print(
            f"{time[number]:4.2f}  {touch.force:8.3f}  {touch.shear_force[0]:9.3f}  {1e3 * touch.torque:11.3f}  {touch.slip_share:8.0%}"
            + ("" if touch.settled else "  not settled")
        )
frames[0].save(given.animation, save_all=True, append_images=frames[1:], duration=80, loop=0)
print(f"{given.animation}: {len(frames)} images")
