"""`python -m benchmarks.touch`: one sensor beside the raw limit, Embree on the same rays."""

from __future__ import annotations

import numpy as np
import trimesh

from benchmarks.embree import EmbreeDepth
from benchmarks.timing import alone, each, side_by_side
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.sphere_tracing import sphere_traced_depth
from pipeline.kernels.touch.tactile_image import tactile_image

TURNS = 20
POSES = 5
"""Sensor poses per mesh; times are the mean per sensor."""
RADIUS = 0.25


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


def row(subdivisions: int, sensor: Sensor, rng: np.random.Generator) -> str:
    """Measure one mesh; a line of the table."""
    triangles = wavy_ball(subdivisions)
    poses = [press(triangles, rng) for _ in range(POSES)]
    away = poses[0].copy()
    away[:3, 3] += 4 * RADIUS
    embree, faces = EmbreeDepth(triangles, sensor), box_faces(triangles)
    ways = {
        "raw": each(embree.trace, [embree.rays(pose) for pose in poses]),
        "ray": each(lambda pose: ray_depth(faces, pose, sensor), poses),
        "whole": each(lambda pose: tactile_image(ray_depth(faces, pose, sensor).astype(np.float32), sensor), poses),
        "sphere": each(lambda pose: sphere_traced_depth(faces, pose, sensor), poses),
        "far": each(lambda pose: ray_depth(faces, pose, sensor), [away]),
        "prepare": alone(lambda: box_faces(triangles)),
    }
    times = side_by_side(ways, TURNS)
    cells = "  ".join(f"{times[way]!s:>14} {times[way].least / times['raw'].least:6.2f} x" for way in ("ray", "whole", "sphere"))
    return f"{len(triangles):8}  {times['raw']!s:>14}  {cells}  {times['far']!s:>14}  {times['prepare'].least:11.1f}"


def main() -> None:
    """Print the table."""
    sensor = load_sensor("gel_16mm")
    rng = np.random.default_rng(0)
    print(f"One sensor, {sensor.rows} x {sensor.cols} rays: least / median ms, and the least over raw Embree's least.")
    kernels = "  ".join(f"{name:>23}" for name in ("ray", "ray + image", "sphere"))
    print(f"{'faces':>8}  {'raw Embree':>14}  {kernels}  {'far sensor':>14}  {'once a mesh':>11}")
    for subdivisions in (3, 4, 5, 6, 7):
        print(row(subdivisions, sensor, rng), flush=True)


if __name__ == "__main__":
    main()
