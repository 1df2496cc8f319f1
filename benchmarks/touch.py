"""One sensor end to end beside the raw limit: Embree on the same rays, in one run. `python -m benchmarks.touch`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from pipeline.config.sensor_file import load_sensor
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor, ray_origins
from pipeline.kernels.touch.sphere_tracing import sphere_traced_depth
from pipeline.kernels.touch.tactile_image import tactile_image

SECONDS = 0.4
"""How long each figure is measured."""
POSES = 5
"""Sensor poses a mesh; what is timed is one sensor, the mean of these."""
RADIUS = 0.25
T = TypeVar("T")


def wavy_ball(subdivisions: int) -> np.ndarray:
    """(F, 3, 3) faces of a ball of the size of an object, with waves of a finger's width."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
    vertices = np.asarray(ball.vertices, np.float64)
    vertices = vertices * (1 + 0.02 * np.sin(vertices * 150).sum(axis=1, keepdims=True) / 3)
    triangles: np.ndarray = vertices[np.asarray(ball.faces)] + np.array([0.0, 0.0, 0.6])
    return triangles


def press(triangles: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(4, 4) pose of a sensor 2 mm deep in a random face, tilted by about 20 degrees."""
    face = triangles[rng.integers(len(triangles))]
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    z = -normal / np.linalg.norm(normal) + rng.normal(size=3) * 0.2
    z /= np.linalg.norm(z)
    x = np.cross(rng.normal(size=3), z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = face.mean(axis=0) - 0.0048 * z
    return pose


def timed(call: Callable[[T], object], arguments: Sequence[T]) -> tuple[float, float]:
    """Least and median milliseconds of a call, each the mean over the arguments."""
    times: list[float] = []
    stop = time.perf_counter() + SECONDS
    while time.perf_counter() < stop or len(times) < 3:
        start = time.perf_counter()
        for argument in arguments:
            call(argument)
        times.append((time.perf_counter() - start) * 1e3 / len(arguments))
    return min(times), float(np.median(times))


def row(subdivisions: int, sensor: Sensor, rng: np.random.Generator) -> str:
    """Measure one mesh; a line of the table."""
    triangles = wavy_ball(subdivisions)
    poses = [press(triangles, rng) for _ in range(POSES)]
    scene = EmbreeScene()
    mesh = TriangleMesh(scene, triangles.astype(np.float32))
    start = time.perf_counter()
    faces = box_faces(triangles)
    prepare = (time.perf_counter() - start) * 1e3

    def embree(rays: tuple[np.ndarray, np.ndarray]) -> None:
        scene.run(*rays)

    def ray(pose: np.ndarray) -> None:
        ray_depth(faces, pose, sensor)

    def whole(pose: np.ndarray) -> None:
        tactile_image(ray_depth(faces, pose, sensor).astype(np.float32), sensor)

    def sphere(pose: np.ndarray) -> None:
        sphere_traced_depth(faces, pose, sensor)

    raw = timed(embree, [float32_rays(pose, sensor) for pose in poses])
    cells = [timed(kernel, poses) for kernel in (ray, whole, sphere)]
    away = poses[0].copy()
    away[:3, 3] += 4 * RADIUS
    far = timed(ray, [away])
    del mesh
    columns = "  ".join(f"{low:6.2f} /{middle:6.2f} {low / raw[0]:6.2f} x" for low, middle in cells)
    return f"{len(triangles):8}  {raw[0]:5.2f} /{raw[1]:5.2f}  {columns}  {far[0]:5.2f} /{far[1]:5.2f}  {prepare:9.1f}"


def float32_rays(pose: np.ndarray, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (rows · cols, 3) of a sensor's rays as Embree takes them."""
    origins = ray_origins(pose, sensor).reshape(-1, 3).astype(np.float32)
    return origins, np.tile(pose[:3, 2].astype(np.float32), (len(origins), 1))


def main() -> None:
    """Print the table."""
    sensor = load_sensor("gel_16mm")
    rng = np.random.default_rng(0)
    print(f"One sensor, {sensor.rows} x {sensor.cols} rays: least / median ms, and the least over raw Embree's least.")
    kernels = "  ".join(f"{name:>23}" for name in ("ray", "ray + reading", "sphere"))
    print(f"{'faces':>8}  {'raw Embree':>12}  {kernels}  {'far sensor':>12}  {'once a mesh':>9}")
    for subdivisions in (3, 4, 5, 6, 7):
        print(row(subdivisions, sensor, rng), flush=True)


if __name__ == "__main__":
    main()
