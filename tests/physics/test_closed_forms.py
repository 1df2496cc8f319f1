"""Coulomb's law in both engines: what two opposed pads hold, to 5 %."""

from typing import get_args

import numpy as np
import pytest
import trimesh

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand
from pipeline.physics.engines import Engine, hold_test
from pipeline.physics.hold_test import GRAVITY
from tests.kernels.hand.meshes import centred, points_on
from tests.physics.pincers import ANGLES, RADIUS, SENSOR, pinching_contacts, pinching_pose

ENGINES = get_args(Engine)
FORCE, MASS = 4.0, 0.3
"""N of each pad, and kg."""
LIMIT = -MASS * GRAVITY / (2 * FORCE)
"""The friction that just holds it: 0.37."""


def slips(engine: Engine, hand: Hand, mesh: Mesh, *, friction: float, down: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> bool:
    acceleration = -GRAVITY * np.array(down) / np.linalg.norm(down)
    with hold_test(engine, hand, [SENSOR, SENSOR], mass=MASS, friction=friction) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        grasp = StoredGrasp(pinching_pose(mesh), ANGLES, ANGLES, ANGLES, pinching_contacts(FORCE))
        return test.hold(grasp, acceleration=acceleration.tolist(), limit=0.01).moved > 0.01


@pytest.mark.parametrize("engine", ENGINES)
def test_sphere_between_two_fingers_slips_below_the_friction_limit(engine: Engine, pincers: Hand) -> None:
    sphere = centred(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))
    assert not slips(engine, pincers, sphere, friction=1.05 * LIMIT)
    assert slips(engine, pincers, sphere, friction=0.95 * LIMIT)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("down", [(1.0, 0.0, 0.0), (1.0, 0.0, -1.0), (-0.5, 0.0, -1.0)])
def test_friction_of_pads_is_isotropic(engine: Engine, pincers: Hand, down: tuple[float, float, float]) -> None:
    plate = centred(trimesh.creation.box((0.1, 2 * RADIUS, 0.1)))
    assert not slips(engine, pincers, plate, friction=1.05 * LIMIT, down=down)
    assert slips(engine, pincers, plate, friction=0.95 * LIMIT, down=down)
