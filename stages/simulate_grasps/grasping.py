"""The search for an object's best grasps, and their hold test."""

from collections import Counter
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.dataset.grasps import grasp_row
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs, Unit
from pipeline.errors import InvalidInput
from pipeline.kernels.hand.grasp import Grasp
from pipeline.physics.hold_test import DOWN, HOLD_TESTS, HoldTest
from pipeline.physics.motion import is_held
from pipeline.physics.simulation import Simulation
from pipeline.store.rows import Row
from stages.simulate_grasps.grasp_search import Attempt, GraspSearch, Planner
from stages.simulate_grasps.hold_plan import HoldPlanner, prepare_pinches
from stages.simulate_grasps.prepare import CLEARANCE, PreparedObject, prepare_hand, prepare_object
from stages.simulate_grasps.stage import MAX_ATTEMPTS_FACTOR, GraspSettings
from stages.simulate_grasps.touch_plan import TouchPlanner


class Grasping:
    """Search the grasps of one object after another, with one hand and physics clients, which `opened` closes."""

    def __init__(self, settings: GraspSettings, opened: ExitStack) -> None:
        self.settings, self.hand = settings, prepare_hand(settings)
        self.pinches = prepare_pinches(self.hand) if settings.search == "hold" else None
        self.physics = opened.enter_context(Simulation(self.hand.hand))
        self.test = None
        if settings.test != "none":
            self.test = opened.enter_context(HoldTest(self.hand.hand, self.hand.sensors, mass=settings.hold_mass))

    def process(self, unit: Unit, inputs: Inputs) -> Row:
        """Search the best grasps of an object and make its row."""
        surface, count = inputs["surfaces"], self.settings.grasps
        mesh = read_mesh(surface)
        prepared_object = prepare_object(mesh, surface["points"], surface["normals"], reach=self.hand.reach)
        self.physics.load(mesh)
        if self.test is not None:
            self.test.load(mesh, prepared_object.points)
        search = GraspSearch(self.hand, prepared_object, self.physics, self.settings, self._planner(prepared_object, unit))
        kept, touched, faults = self._search(search, unit)
        if len(kept) < count:
            most_common_fault = faults.most_common(1)[0][0]
            raise InvalidInput(
                f"{len(kept)} of {count} grasps found in {len(touched)} attempts: {most_common_fault}; scale the object "
                f"({', '.join(f'{extent:.3g}' for extent in np.ptp(mesh.vertices, axis=0))} m) to between one and five hands, "
                f"or raise simulate-grasps.attempts"
            )
        return {
            **grasp_row([attempt.grasp for attempt in kept]),
            "closure": np.array([search.closure(attempt.grasp) for attempt in kept], np.float32),
            "penetration": np.array([attempt.penetration for attempt in kept], np.float32),
            "attempts": np.array(len(touched), np.int32),
            "attempt_success": np.mean(touched, axis=0).astype(np.float32),
            **self._held(kept),
        }

    def _planner(self, prepared_object: PreparedObject, unit: Unit) -> Planner:
        if self.pinches is None:
            return TouchPlanner(self.hand, prepared_object, self.settings)
        return HoldPlanner.of_object(self.hand, prepared_object, self.settings, self.pinches, unit.rng("simulate-grasps", "rays"))

    def _search(self, search: GraspSearch, unit: Unit) -> tuple[list[Attempt], list[NDArray[np.bool_]], Counter[str]]:
        """Attempt grasps until no better ones are needed; return the best, which sensors touched in each attempt, and counts of faults."""
        settings = self.settings
        kept: list[Attempt] = []
        touched, faults = [], Counter[str]()
        for number in range(MAX_ATTEMPTS_FACTOR * settings.attempts):
            full = len(kept) == settings.grasps
            if (number >= settings.attempts and (full or not kept)) or (full and self._are_enough(kept)):
                break
            attempt = search.attempt(unit.rng("simulate-grasps", number))
            touched.append(attempt.grasp.touched if attempt else np.zeros(len(self.hand.hand.sensors), bool))
            if attempt is None:
                faults[f"the hand has no room around the object with clearance {CLEARANCE:g} m"] += 1
            elif attempt.fault is not None:
                faults[attempt.fault] += 1
            else:
                if settings.search == "hold":
                    motions, holds = self._measure(attempt.grasp, to_end=False)
                    attempt = replace(attempt, holds=holds, motions=motions)
                kept = search.keep_best(kept, attempt)
        return kept, touched, faults

    def _are_enough(self, kept: list[Attempt]) -> bool:
        """Check whether the search may end: no attempt can add touches to these grasps or, in a hold search, all of them hold."""
        if self.settings.makes_all_attempts:
            return False
        return all(attempt.holds if self.settings.search == "hold" else attempt.grasp.touched.all() for attempt in kept)

    def _measure(self, grasp: Grasp, *, to_end: bool) -> tuple[NDArray[np.float32], bool]:
        """Measure how far, m, and how fast, m/s, the object moved at the end of the hold test in each direction, (D, 2).

        Unless `to_end`, the first direction in which the grasp does not hold is the last. Also return whether it holds in all; without a
        test each grasp does.
        """
        if self.test is None:
            return np.empty((0, 2), np.float32), True
        motions, holds = [], True
        for acceleration in HOLD_TESTS[self.settings.test]:
            motion = self.test.hold(grasp, acceleration=acceleration)
            motions.append(np.array([motion.moved, motion.speed], np.float32))
            holds &= bool(is_held(*motions[-1]))
            if not (holds or to_end):
                break
        return np.stack(motions), holds

    def _held(self, kept: list[Attempt]) -> Row:
        """Tell which grasps hold, and how the object moved; those that have not passed all directions are tested in each of them."""
        if self.test is None:
            return {}
        motions = [attempt.motions if attempt.holds else self._measure(attempt.grasp, to_end=True)[0] for attempt in kept]
        distance, speed = np.moveaxis(np.stack(motions), -1, 0)
        held = is_held(distance, speed)
        row = {"held": held[:, HOLD_TESTS[self.settings.test].index(DOWN)], "hold_distance": distance, "hold_speed": speed}
        return row | ({"held_directions": held} if self.settings.test == "six" else {})
