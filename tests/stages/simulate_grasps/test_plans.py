"""Plans of a hold search: skipped candidates would not have been chosen."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.kernels.hand.load_residual import NO_SUPPORT, RESIDUAL_STEP, Support, load_residual
from pipeline.kernels.hand.pinches import opposed_postures
from pipeline.rng import numpy_rng
from stages.simulate_grasps import plans
from stages.simulate_grasps.plans import HoldPlanner
from stages.simulate_grasps.prepare import PreparedHand, prepare_object
from tests.kernels.hand.meshes import centred, points_on
from tests.stages.simulate_grasps.conftest import SETTINGS


@pytest.fixture(scope="module")
def planner(prepared: PreparedHand) -> HoldPlanner:
    box = centred(trimesh.creation.box((0.05, 0.06, 0.12)))
    thing = prepare_object(box, *points_on(box, 2000, seed=1), reach=prepared.reach)
    settings = SETTINGS.model_copy(update={"search": "hold", "plans": 3})
    slippery = replace(prepared, hand=replace(prepared.hand, friction=0.2))  # at 0.5 all plans carry the box
    return HoldPlanner(slippery, thing, settings, opposed_postures(slippery.ik), numpy_rng(0, "rays"))


def test_planner_finds_plans_for_fingers_opposed_at_an_angle(planner: HoldPlanner) -> None:
    none, hand, thing = planner.postures.rows(np.empty(0, np.intp)), planner.prepared_hand, planner.prepared_object
    assert HoldPlanner(hand, thing, planner.settings, none, numpy_rng(0, "rays"))(numpy_rng(0, "plan", 0)) is not None


def test_plans_equal_those_of_exhaustive_search(planner: HoldPlanner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every contact measured, every residual computed to its end, every plan made, and the best of them all taken."""
    lazy = [planner(numpy_rng(0, "plan", number)) for number in range(8)]
    loads: list[int] = []

    def slow(points: np.ndarray, normals: np.ndarray, touching: np.ndarray, friction: float, best: Support) -> tuple[int, Support]:
        number = -1
        for row in range(len(points)):
            steps = int(load_residual(points[row], normals[row], touching[row], friction) // RESIDUAL_STEP)
            load = Support(steps, int(touching[row].sum()))
            if (load.steps, -load.touches) < (best.steps, -best.touches):
                number, best = row, load
        loads.append(best.steps)
        return number, best

    monkeypatch.setattr(plans, "BATCHES", ())
    monkeypatch.setattr(plans, "best_supporting_grasp", slow)
    monkeypatch.setattr(HoldPlanner, "_is_perfect", lambda *_: False)
    for number, plan in enumerate(lazy):
        expected = planner(numpy_rng(0, "plan", number))
        assert plan is not None
        assert expected is not None
        for planned, wanted in zip(plan, expected, strict=True):
            np.testing.assert_array_equal(planned, wanted)
    assert 0 in loads
    assert 0 < max(loads) < NO_SUPPORT.steps
