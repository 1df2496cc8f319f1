"""A hand made ready once, and grasps of two simple objects to look at from several sides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from pipeline.config.hand_file import load_hand
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.rng import numpy_rng
from stages.simulate_grasps.attempt import Grasp, attempt
from stages.simulate_grasps.physics import Simulation, simulation
from stages.simulate_grasps.rig import Rig, Scene, make_rig, make_scene
from stages.simulate_grasps.settings import GraspSettings

SETTINGS = GraspSettings(ik_samples=512, attempts=5)


def mug() -> Mesh:
    """An open cup with a thin wall and a handle: concave, so that its hull would keep fingers out of it."""
    profile = np.array([[0.0, 0.0], [0.09, 0.0], [0.09, 0.2], [0.084, 0.2], [0.084, 0.006], [0.0, 0.006]])
    cup = trimesh.creation.revolve(profile, sections=48)
    handle = trimesh.creation.torus(0.06, 0.012).apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return placed(cup, handle.apply_translation([0.16, 0, 0.1]))


def bar() -> Mesh:
    """A flat bar, thin as a knife."""
    return placed(trimesh.creation.box((0.45, 0.05, 0.008)))


def placed(*parts: trimesh.Trimesh) -> Mesh:
    """Where objects stand: around (0, 0, 0.6)."""
    whole = trimesh.util.concatenate(parts)
    return Mesh.bare(whole.vertices - whole.bounds.mean(axis=0) + [0, 0, 0.6], whole.faces)


def points_on(mesh: Mesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points on a mesh, and the normals there."""
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, faces = trimesh.sample.sample_surface(body, count, seed=seed)
    return np.asarray(points), np.asarray(body.face_normals[faces])


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand("allegro_right")


@pytest.fixture(scope="session")
def rig() -> Rig:
    return make_rig(SETTINGS)


@pytest.fixture(scope="session")
def grasped(rig: Rig) -> list[tuple[Mesh, Scene, list[Grasp]]]:
    """Two objects and the sound grasps of a few attempts at each."""
    result = []
    with simulation(rig.hand) as physics:
        for mesh in (mug(), bar()):
            scene = make_scene(mesh, *points_on(mesh, 2000, seed=1), SETTINGS.grid_cell)
            physics.load(mesh)
            grasps = [attempt(rig, scene, physics, SETTINGS, numpy_rng(0, "grasped", number)) for number in range(5)]
            result.append((mesh, scene, [grasp for grasp in grasps if grasp is not None and grasp.sound]))
    return result


@pytest.fixture
def try_at(rig: Rig) -> Callable[[Simulation, Mesh, int], Grasp | None]:
    """An attempt by number at a mesh that is loaded."""

    def run(physics: Simulation, mesh: Mesh, number: int) -> Grasp | None:
        scene = make_scene(mesh, *points_on(mesh, 2000, seed=1), SETTINGS.grid_cell)
        return attempt(rig, scene, physics, SETTINGS, numpy_rng(0, "grasped", number))

    return run
