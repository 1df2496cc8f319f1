"""The search for an object's best grasps: plan, close the fingers in physics, measure where they come to rest, test whether it holds."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace

import numpy as np

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs, Unit
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.distance_field import finger_clearance
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.pinches import opposed_postures
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.kernels.hand.self_collision import hand_gap
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.simulation import Simulation
from pipeline.store.rows import Row
from stages.simulate_grasps.measured_grasps import Attempt, MeasuredGrasps
from stages.simulate_grasps.plans import HoldPlanner, TouchPlanner
from stages.simulate_grasps.prepare import CLEARANCE, prepare_hand, prepare_object
from stages.simulate_grasps.stage import MAX_ATTEMPTS_FACTOR, GraspSettings

OVERLOADED = "a gel presses harder than the finger's motors, and there is no room to open it"
OPENING = 0.006  # m that each sensor is drawn back before it closes: about a gel's thickness; 0 and 12 mm touch as often
RESTING_SPEED = 2e-3  # rad/s below which a joint rests, a tenth of it in m/s where it slides: at most 1 µm of the sensor's way in a step


@contextmanager
def grasping(settings: GraspSettings) -> Iterator[Callable[[Unit, Inputs], Row]]:
    """Prepare the hand and open physics clients; yield what searches the best grasps of an object and makes its row."""
    hand = prepare_hand(settings)
    postures = opposed_postures(hand.ik) if settings.search == "hold" else None
    with ExitStack() as opened:
        physics, test = opened.enter_context(Simulation(hand.hand)), None
        if settings.test != "none":
            test = opened.enter_context(HoldTest(hand.hand, hand.sensors, mass=settings.hold_mass))

        def process(unit: Unit, inputs: Inputs) -> Row:
            surface = inputs["surfaces"]
            mesh = read_mesh(surface)
            prepared_object = prepare_object(mesh, surface["points"], surface["normals"], reach=hand.reach)
            physics.load(mesh)
            if test is not None:
                test.load(mesh, prepared_object.points)
            if postures is None:
                plan = TouchPlanner(hand, prepared_object, settings)
            else:
                plan = HoldPlanner(hand, prepared_object, settings, postures, unit.rng("simulate-grasps", "rays"))
            return GraspSearch(plan, physics, test).best_grasps(unit)

        yield process


class GraspSearch(MeasuredGrasps):
    """The search for grasps of one object, which physics and hold test have loaded."""

    def __init__(self, plan: TouchPlanner, physics: Simulation, test: HoldTest | None = None) -> None:
        super().__init__(plan.prepared_hand, plan.prepared_object, plan.settings, test)
        self.plan, self.physics = plan, physics
        self.settings, self.hand = plan.settings, plan.prepared_hand

    def best_grasps(self, unit: Unit) -> Row:
        """Attempt grasps until no better ones are needed, and make the row of the best."""
        settings = self.settings
        kept: list[Attempt] = []
        touched, faults = [], Counter[str]()
        for number in range(MAX_ATTEMPTS_FACTOR * settings.attempts):
            full = len(kept) == settings.grasps
            if (number >= settings.attempts and (full or not kept)) or (full and self._are_enough(kept)):
                break
            attempt = self.attempt(unit.rng("simulate-grasps", number))
            touched.append(attempt.grasp.touched if attempt else np.zeros(len(self.hand.sensors), bool))
            if attempt is None:
                faults[f"the hand has no room around the object with clearance {CLEARANCE:g} m"] += 1
            elif attempt.fault is not None:
                faults[attempt.fault] += 1
            else:
                if settings.search == "hold":
                    motions, holds = self._measure(attempt.grasp, to_end=False)
                    attempt = replace(attempt, holds=holds, motions=motions)
                kept = self.keep_best(kept, attempt)
        if len(kept) < settings.grasps:
            extents = ", ".join(f"{extent:.3g}" for extent in np.ptp(self.object.field.vertices, axis=0))
            raise InvalidInput(
                f"{len(kept)} of {settings.grasps} grasps found in {len(touched)} attempts: {faults.most_common(1)[0][0]}; scale the "
                f"object ({extents} m) to between one and five hands, or raise simulate-grasps.attempts"
            )
        return {
            **self.row(kept),
            "attempts": np.array(len(touched), np.int32),
            "attempt_success": np.mean(touched, axis=0).astype(np.float32),
        }

    def attempt(self, rng: np.random.Generator) -> Attempt | None:
        """Make one grasp, which depends on the search and `rng` alone; None without a plan."""
        posture = self.plan(rng)
        return None if posture is None else self._close(*posture)

    def _close(self, pose: Array, target: Array) -> Attempt:
        hand, settings = self.hand.hand, self.settings
        start = self._pregrasp(pose, target)
        angles, rests = self.physics.settle(pose, start, target, max_steps=settings.settle_steps, resting_speed=RESTING_SPEED)
        angles, within = self.closed(pose, start, angles)
        attempt = self.measure(pose, start, angles)
        fault = attempt.fault
        if not rests:
            fault = f"fingers still move after {settings.settle_steps} steps (simulate-grasps.settle_steps)"
        elif not within:
            fault = OVERLOADED
        elif not ((angles >= hand.lower) & (angles <= hand.upper)).all():
            fault = "a joint is pushed beyond its limit"
        elif hand_gap(hand, self.hand.ik.boxes, forward_kinematics(hand, pose, angles)) < 0:
            fault = "links of the hand overlap"
        return replace(attempt, fault=fault)

    def _pregrasp(self, pose: Array, target: Array) -> Array:
        """Compute the joint angles from which the fingers close: each finger is drawn back as far as there is room behind it."""
        hand, ik = self.hand.hand, self.hand.ik
        postures = pregrasp_angles(hand, target, [OPENING, OPENING / 2, 0.0])
        clear = finger_clearance(self.object.field, ik.fingers, forward_kinematics(hand, pose, postures), floor=0.0) >= 0  # (3, F)
        start = target.copy()
        for number, finger in enumerate(hand.fingers):
            if clear[:, number].any():
                start[list(finger.joints)] = postures[clear[:, number].argmax()][list(finger.joints)]
        fits = hand_gap(hand, ik.boxes, forward_kinematics(hand, pose, start)) >= 0
        return start if fits else target

    def score(self, grasp: Grasp) -> tuple[float, ...]:
        """Score a grasp by the setting `prefer`; the greatest is best."""
        touches = int(grasp.touched.sum())
        match self.settings.prefer:
            case "touches":
                return (touches,)
            case "area":
                return (float(grasp.contact_area.sum()),)
            case "closure":
                return (self.closure(grasp), touches)

    def keep_best(self, kept: list[Attempt], attempt: Attempt) -> list[Attempt]:  # best first, the earlier of equals first
        """Add a sound grasp to the best ones so far, those that hold first, and keep as many as the settings ask for."""
        best = sorted([*kept, attempt], key=lambda item: (item.holds, *self.score(item.grasp)), reverse=True)  # stable even so
        return best[: self.settings.grasps]

    def _are_enough(self, kept: list[Attempt]) -> bool:
        """Check whether the search may end: no attempt can add touches to these grasps or, in a hold search, all of them hold."""
        if self.settings.makes_all_attempts:
            return False
        return all(attempt.holds if self.settings.search == "hold" else attempt.grasp.touched.all() for attempt in kept)
