"""Press a sensor on a mesh and write the tactile image as a PNG, without a dataset or physics."""

import argparse

import numpy as np
import trimesh
from PIL import Image

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("image", nargs="?", default="tactile.png", help="PNG to write; default: %(default)s")
parser.add_argument("mesh", nargs="?", help="a mesh file; default: a ball of 2 cm radius")
given = parser.parse_args()
mesh = trimesh.load_mesh(given.mesh) if given.mesh else trimesh.creation.icosphere(subdivisions=5, radius=0.02)
sensor = load_sensor("gel_16mm")  # or the path of a sensor file

# The sensor is above the highest vertex and faces down: its +z (outward normal) is the world's -z.
# Its plane is 5 mm from the vertex, so the mesh presses w - 5 mm = 1.8 mm into the gel.
pose = np.diag([1.0, -1.0, -1.0, 1.0])  # sensor frame to world frame
pose[:3, 3] = mesh.vertices[np.argmax(mesh.vertices[:, 2])] + (0, 0, 0.005)

depth = ray_depth(box_faces(np.asarray(mesh.triangles, np.float64)), pose, sensor)  # (rows, cols), m, +inf where no surface is in range
image = tactile_image(depth, sensor)  # (rows, cols, 3) uint8
Image.fromarray(image).save(given.image)
print(f"nearest {1e3 * depth.min():.2f} mm, gel {1e3 * sensor.w:.1f} mm, success {bool(touch_success(depth, sensor))}; {given.image}")
