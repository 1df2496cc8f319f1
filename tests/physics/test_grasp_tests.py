"""The field's tests of grasps, of a plate between two fingers: what they demand, and what they refuse."""

from typing import get_args

import pytest
import trimesh

from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.kernels.hand.model import Hand
from pipeline.physics.engines import Engine, open_test
from pipeline.physics.grasp_tests import GRASP_TESTS
from tests.kernels.hand.meshes import centred, points_on
from tests.physics.pincers import ANGLES, RADIUS, SENSOR, pinching_contacts, pinching_pose

PLATE = centred(trimesh.creation.box((0.1, 2 * RADIUS, 0.1)))


def holds(engine: Engine, name: str, hand: Hand, *, force: float, pregrasp: float = 0.005) -> bool:
    """Test a pinch with this force, N, from fingers that are this much wider, m, and that squeeze by half a millimetre."""
    grasp = StoredGrasp(pinching_pose(PLATE), ANGLES + pregrasp, ANGLES, ANGLES - 5e-4, pinching_contacts(force))
    with open_test(GRASP_TESTS[name], engine, hand, [SENSOR, SENSOR]) as test:
        test.load(PLATE, points_on(PLATE, 2000, seed=0)[0])
        return GRASP_TESTS[name].holds(test, grasp)


@pytest.mark.parametrize("engine", get_args(Engine))
@pytest.mark.parametrize("name", GRASP_TESTS)
def test_pinch_holds_if_friction_carries_the_force(engine: Engine, name: str, pincers: Hand) -> None:
    test = GRASP_TESTS[name]
    needed = test.mass * test.acceleration / (2 * (test.friction or pincers.friction))
    assert holds(engine, name, pincers, force=2.5 * needed)
    assert not holds(engine, name, pincers, force=0.4 * needed)


def test_start_inside_the_object_is_refused(pincers: Hand) -> None:
    """MuJoCo's convex parts are solid; in PyBullet's surface a gel that is all inside meets nothing."""
    assert not holds("mujoco", "dexgraspbench", pincers, force=4.0, pregrasp=-0.015)
