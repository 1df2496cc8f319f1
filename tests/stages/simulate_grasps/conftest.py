"""A hand prepared once, and grasps of two simple objects that several tests look at."""

import pytest

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.model import Hand
from pipeline.physics.simulation import Simulation
from pipeline.rng import numpy_rng
from stages.simulate_grasps.grasp_search import GraspSearch
from stages.simulate_grasps.measured_grasps import Attempt
from stages.simulate_grasps.plans import TouchPlanner
from stages.simulate_grasps.prepare import PreparedHand, prepare_hand, prepare_object
from stages.simulate_grasps.stage import GraspSettings
from tests.kernels.hand.meshes import bar, mug, points_on

SETTINGS = GraspSettings(ik_samples=512, attempts=5)
Grasped = list[tuple[Mesh, list[tuple[Grasp, float]]]]
"""Meshes, each with grasps and their penetrations, m."""


def attempt(prepared: PreparedHand, physics: Simulation, mesh: Mesh, number: int) -> Attempt | None:
    """Make an attempt, by number, at a mesh that is loaded."""
    thing = prepare_object(mesh, *points_on(mesh, 2000, seed=1), reach=prepared.reach)
    return GraspSearch(TouchPlanner(prepared, thing, SETTINGS), physics).attempt(numpy_rng(0, "grasped", number))


@pytest.fixture(scope="session")
def prepared() -> PreparedHand:
    return prepare_hand(SETTINGS)


@pytest.fixture(scope="session")
def hand(prepared: PreparedHand) -> Hand:
    return prepared.hand


@pytest.fixture(scope="session")
def grasped(prepared: PreparedHand) -> Grasped:
    """Two objects and the sound grasps of a few attempts at each."""
    result = []
    with Simulation(prepared.hand) as physics:
        for mesh in (mug(), bar()):
            physics.load(mesh)
            attempts = [attempt(prepared, physics, mesh, number) for number in range(5)]
            result.append((mesh, [(item.grasp, item.penetration) for item in attempts if item is not None and item.fault is None]))
    return result
