"""Meshes around (0, 0, 0.6), where objects of a dataset are, and poses of hands."""

import numpy as np
import trimesh

from pipeline.kernels.geometry.mesh import Mesh
from tests.strategies import random_rotation


def centred(*parts: trimesh.Trimesh) -> Mesh:
    """Join the parts into one mesh, moved to (0, 0, 0.6)."""
    whole = trimesh.util.concatenate(parts)
    return Mesh.bare(whole.vertices - whole.bounds.mean(axis=0) + [0, 0, 0.6], whole.faces)


def mug() -> Mesh:
    """Make an open cup with a thin wall and a handle: concave, so that its hull would keep fingers out of it."""
    profile = np.array([[0.0, 0.0], [0.09, 0.0], [0.09, 0.2], [0.084, 0.2], [0.084, 0.006], [0.0, 0.006]])
    cup = trimesh.creation.revolve(profile, sections=48)
    handle = trimesh.creation.torus(0.06, 0.012).apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return centred(cup, handle.apply_translation([0.16, 0, 0.1]))


def bar() -> Mesh:
    """Make a flat bar, thin as a knife."""
    return centred(trimesh.creation.box((0.45, 0.05, 0.008)))


def points_on(mesh: Mesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points on a mesh, and the normals there."""
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, faces = trimesh.sample.sample_surface(body, count, seed=seed)
    return np.asarray(points), np.asarray(body.face_normals[faces])


def random_pose(rng: np.random.Generator, position: np.ndarray | None = None) -> np.ndarray:
    """(4, 4) a random rotation at a random or the given position."""
    pose = np.eye(4)
    pose[:3, :3] = random_rotation(rng)
    pose[:3, 3] = rng.normal(size=3) if position is None else position
    return pose
