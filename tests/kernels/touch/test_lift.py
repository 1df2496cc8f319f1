"""Lifts of a ball between two gels, of which Coulomb's law and symmetry say what they do; and of one that nothing holds."""

import numpy as np
import pytest

from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.depth_maps import normal_force
from pipeline.kernels.touch.lift import EARTH, FULL, FreedObject, LiftStep, lift_object, rests
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.kernels.touch.sliding import SlideStep
from tests.kernels.touch.gels import sensor
from tests.kernels.touch.shapes import pose_at

GEL = sensor(24, 24, poisson=0.48, thickness=0.006, pitch=3e-4)
BALL, MASS, STEPS, RATE = 0.01, 0.02, 16, 32.0
"""Radius, m, and mass, kg; steps of a lift, and how many per second."""
WEIGHT = MASS * EARTH


def ball_depth(pose: Array, worn: Sensor) -> np.ndarray:
    """Trace a ball about the origin."""
    x, y = pixel_centres(worn)
    centre = -pose[:3, :3].T @ pose[:3, 3]  # in the sensor's frame
    squared = (x[None] - centre[0]) ** 2 + (y[:, None] - centre[1]) ** 2
    height = centre[2] - np.sqrt(np.maximum(BALL**2 - squared, 0))
    return np.where((squared < BALL**2) & (height >= 0), height, np.inf).astype(np.float32)


def lift(*deep: float, friction: float = 1.0, steps: int = STEPS, squeeze: float = 0.0) -> list[LiftStep]:
    """Lift the ball, which gels at its left and its right press so deep, m; by default fingers stay still."""
    poses = [pose_at(BALL * np.array([side, 0.0, 0.0]), np.array([-side, 0, 0]), GEL.w - d) for side, d in zip((1, -1), deep, strict=True)]
    body = FreedObject(ball_depth, np.zeros(3), 0.8 * BALL, MASS)
    return list(lift_object(body, poses, [GEL] * 2, [friction] * 2, squeeze=squeeze, steps=steps, rate=RATE))


def pressing(touch: SlideStep) -> float:
    return normal_force(touch.gel.pressure, touch.sensor)


def world_force(step: LiftStep) -> np.ndarray:
    """Force of the gels on the ball: the sensors do not turn, and the ball's turn is taken back."""
    total = np.zeros(3)
    for touch in step.touches:
        turn = step.pose[:3, :3] @ touch.pose[:3, :3]
        total -= turn @ [*touch.shear_force, -pressing(touch)]
    return total


@pytest.fixture(scope="module")
def held() -> list[LiftStep]:
    return lift(4e-4, 4e-4)


def test_gels_carry_the_weight_once_the_object_rests(held):
    for number, step in enumerate(held):
        assert step.held
        assert step.settled
        assert step.weight == pytest.approx(WEIGHT * np.clip((number / STEPS - 1 / 8) / (3 / 8), 0, 1))
    for step in held[int(FULL * STEPS) + 2 :]:
        np.testing.assert_allclose(world_force(step), [0, 0, WEIGHT], atol=0.01 * WEIGHT)
        assert step.imbalance == pytest.approx(np.linalg.norm(world_force(step) - [0, 0, WEIGHT]), abs=1e-9)
    assert held[-1].pose[2, 3] < 0  # the gels give way to the weight


def test_equal_gels_carry_half_each(held):
    left, right = held[-1].touches
    assert np.linalg.norm(left.shear_force) == pytest.approx(WEIGHT / 2, rel=0.01)
    assert np.linalg.norm(right.shear_force) == pytest.approx(WEIGHT / 2, rel=0.01)


def test_a_freed_object_moves_to_where_the_gels_press_alike():
    steps = lift(5e-4, 2e-4)
    first, last = steps[0], steps[-1]
    assert pressing(first.touches[0]) > 3 * pressing(first.touches[1])
    assert pressing(last.touches[0]) == pytest.approx(pressing(last.touches[1]), rel=0.02)
    assert last.pose[0, 3] == pytest.approx(-1.5e-4, abs=5e-6)  # to the middle


def test_it_slips_out_where_friction_carries_less_than_the_weight(held):
    least = WEIGHT / sum(map(pressing, held[0].touches))  # coefficient at which friction just carries it
    caught, lost = lift(4e-4, 4e-4, friction=1.3 * least), lift(4e-4, 4e-4, friction=0.7 * least)
    assert caught[-1].held
    assert caught[-1].imbalance < 0.02 * WEIGHT
    assert not lost[-1].held
    slipping = [all(touch.gross_slip for touch in step.touches) for step in lost if step.held]
    assert slipping[-1]
    assert not slipping[1]  # before its weight grows
    assert not any(touch.gel.contact.any() for touch in lost[-1].touches)


def test_an_object_that_nothing_touches_is_gone():
    steps = lift(-5e-4, -5e-4)
    assert not any(step.held for step in steps[1:])
    assert steps[-1].imbalance == pytest.approx(steps[-1].weight)
    assert steps[-1].weight == pytest.approx(WEIGHT)


def test_more_steps_end_where_fewer_do(held):
    finer = lift(4e-4, 4e-4, steps=2 * STEPS)
    assert finer[-1].pose[2, 3] == pytest.approx(held[-1].pose[2, 3], rel=0.02)


def test_motors_press_on_while_the_object_settles():
    """Springs of one stiffness: a sensor closes by what its gel loses in force; where fingers stay still the gels lose more of it."""
    squeeze = 1e-3
    steps, still = lift(5e-4, 2e-4, squeeze=squeeze), lift(5e-4, 2e-4)
    grip = np.array([pressing(touch) for touch in steps[0].touches])
    for step in steps[1:]:
        now = [pressing(touch) for touch in step.touches]
        np.testing.assert_allclose(now, grip - grip.max() / squeeze * step.closed, atol=0.01 * WEIGHT)
    assert rests(steps[-1].held, steps[-1].imbalance, steps[-1].weight, [steps[-1].settled])
    assert steps[-1].closed[0] > 0 > steps[-1].closed[1]
    total, stiff = (sum(map(pressing, path[-1].touches)) for path in (steps, still))
    assert stiff < 0.9 * grip.sum() < 0.95 * grip.sum() < total
