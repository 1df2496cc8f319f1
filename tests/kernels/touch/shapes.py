"""Sensors, poses and faces that the touch tests share."""

from pathlib import Path
from typing import Any

import numpy as np
import pybullet_data
import trimesh

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.sensor import Sensor, pixel_centres, sensor_to_world
from tests.strategies import random_rotation

SENSOR = load_sensor("gel_16mm")
DATA = Path(pybullet_data.getDataPath())
NAMED = ("duck.obj", "objects/mug.obj", "teddy2_VHACD_CHs.obj", "bunny.obj")
TWENTY = NAMED + tuple(f"random_urdfs/{k:03d}/{k:03d}.obj" for k in range(0, 1000, 63))


def coarse(pixels: int) -> Sensor:
    """Return the shipped sensor with fewer pixels."""
    return SENSOR.model_copy(update={"rows": pixels, "cols": pixels})


def frame(z: np.ndarray, spin: float = 0.0) -> np.ndarray:
    """(3, 3) rotation whose third column is along `z`, turned by `spin` rad about it."""
    z = z / np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    return np.stack([np.cos(spin) * x + np.sin(spin) * y, np.cos(spin) * y - np.sin(spin) * x, z], axis=1)


def pose_at(point: np.ndarray, z: np.ndarray, distance: float, spin: float = 0.0) -> np.ndarray:
    """(4, 4) pose of a sensor that looks along `z` at `point`, `distance` m away."""
    pose = np.eye(4)
    pose[:3, :3] = frame(z, spin)
    pose[:3, 3] = point - pose[:3, 2] * distance
    return pose


def ray_origins(pose: np.ndarray, sensor: Sensor) -> np.ndarray:
    """(rows, cols, 3) pixel centres on the sensor plane, world, m, where rays start; they leave along `pose[:3, 2]`."""
    x, y = pixel_centres(sensor)
    return sensor_to_world(pose, x[None, :], y[:, None], np.zeros(sensor.shape))


def random_pose(triangles: np.ndarray, rng: np.random.Generator, tilt: float = 0.5) -> np.ndarray:
    """Press a sensor 0-5 mm onto a random face, its normal off the face's by a random angle of about `tilt` rad."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=1)
    face = rng.choice(len(triangles), p=area / area.sum())
    point = rng.dirichlet([1, 1, 1]) @ triangles[face]
    z = -normals[face] / area[face] + tilt * rng.normal(size=3) / np.sqrt(3)
    return pose_at(point, z, SENSOR.w - rng.uniform(0, 0.005), rng.uniform(0, 2 * np.pi))


def pybullet_triangles(name: str) -> np.ndarray:
    """(F, 3, 3) faces of a mesh of the pybullet wheel, placed as the supplement does: diagonal 0.5 m, z 0.6 m."""
    mesh = trimesh.load(DATA / name, force="mesh", process=False)
    triangles = _soup(mesh)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    placed: np.ndarray = (triangles - (low + high) / 2) / np.linalg.norm(high - low) * 0.5
    placed += np.array([0.0, 0.0, 0.6])
    return placed


def ball(subdivisions: int, radius: float, x: float = 0, y: float = 0, z: float = 0) -> np.ndarray:
    """(F, 3, 3) faces of an icosphere around a point, m."""
    return _soup(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius), x, y, z)


def box(sides: tuple[float, float, float], x: float = 0, y: float = 0, z: float = 0) -> np.ndarray:
    """(12, 3, 3) faces of a box around a point, m."""
    return _soup(trimesh.creation.box(sides), x, y, z)


def _soup(mesh: Any, x: float = 0, y: float = 0, z: float = 0) -> np.ndarray:
    triangles: np.ndarray = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    triangles += np.array([x, y, z])
    return triangles


def sheet(z: float, half: float = 0.1, x: float = 0, y: float = 0) -> np.ndarray:
    """(2, 3, 3) faces of a square around a point, normal to z, m."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64) * half + np.array([x, y, z])
    faces: np.ndarray = corners[[[0, 1, 2], [0, 2, 3]]]
    return faces


def pressed_ball(rng: np.random.Generator, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make a ball of 2 cm around `middle`, and the pose of a sensor pressed 2 mm onto it."""
    towards = random_rotation(rng)[:, 2]
    return ball(3, 0.02) + middle, pose_at(middle - 0.02 * towards, towards, SENSOR.w - 0.002, rng.uniform(0, 6))


def one_pixel(depth: float, sensor: Sensor) -> np.ndarray:
    """Make a depth map in which one pixel, in row 3 and column 5, meets a surface."""
    image = np.full(sensor.shape, np.inf)
    image[3, 5] = depth
    return image
