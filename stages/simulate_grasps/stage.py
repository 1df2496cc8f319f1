"""Supplement 1.3: the hand is set on the object at random, its fingers close, contact settles; the best grasps are kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.console import abbreviate, pluralise
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.stored_grasps import StoredGrasp
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files, sensor_names
from pipeline.kernels.hand.buried_gels import buried_gels
from pipeline.kernels.hand.pregrasp import pregrasp_angles
from pipeline.physics.hand_urdf import inertia_notes
from pipeline.physics.hold_test import DOWN, HOLD_TESTS, HoldTest
from pipeline.physics.motion import is_held
from pipeline.physics.simulation import Simulation
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from stages.simulate_grasps.grasp_search import Grasp, GraspPlan, GraspSearch, keep_best
from stages.simulate_grasps.hold_plan import HoldPlanner, Pinches, prepare_pinches
from stages.simulate_grasps.prepare import PreparedHand, PreparedObject, prepare_hand, prepare_object
from stages.simulate_grasps.settings import SECOND_CHANCES, GraspSettings
from stages.simulate_grasps.size_warnings import opening, size_warnings
from stages.simulate_grasps.touch_plan import TouchPlanner


class SimulateGrasps(ObjectStage):
    """From an object's surface to the poses of the hand and its sensors around it."""

    name = "simulate-grasps"
    summary = "The best grasps of many, settled in physics, and where each touches."
    output = GRASPS
    settings_type = GraspSettings

    def inputs(self, settings: GraspSettings) -> tuple[Artifact, ...]:
        """Name the inputs: the normalised meshes and their surface points."""
        return (SURFACES,)

    def assets(self, settings: GraspSettings) -> list[Path]:
        """List the hand file with all it names, and the fingers' sensor files."""
        hand = load_hand(settings.hand)
        return [*hand.files, *sensor_files(sensor_names(hand, settings.sensor))]

    def constants(self, settings: GraspSettings) -> Row:
        """Name grasps, sensors and joints, for later stages' arrays too."""
        hand = load_hand(settings.hand)
        sensors = np.array([mount.name for mount in hand.sensors])
        return {"grasp": np.arange(settings.grasps, dtype=np.int32), "sensor": sensors, "joint": np.array(hand.joint_names)}

    def attributes(self, settings: GraspSettings) -> dict[str, Any]:
        """Describe the hand: names of joints and sensors, digests of its files. Later stages use no other hand or sensors."""
        hand = load_hand(settings.hand)
        sensors = sensor_names(hand, settings.sensor)
        return {
            "hand": {
                "name": hand.name,
                "joints": list(hand.joint_names),
                "sensors": [mount.name for mount in hand.sensors],
                "digest": assets_digest(hand.files),
                "sensor_files": list(sensors),
                "sensor_digest": assets_digest(sensor_files(sensors)),
            }
        }

    def describe_misfits(self, settings: GraspSettings, objects: Iterable[tuple[str, Inputs]]) -> Iterator[str]:
        """Name links whose mass or inertia is estimated, gels inside their links, and objects that do not fit the hand."""
        hand = load_hand(settings.hand)
        yield from (f"hand {hand.name}: {note}" for note in inertia_notes(hand))
        sensors = load_worn_sensors(sensor_names(hand, settings.sensor))
        yield from (f"hand {hand.name}: {sentence}" for _, sentence in buried_gels(hand, sensors))
        widest = max(sensor.width for sensor in sensors)
        extents = {name: np.ptp(inputs["surfaces"]["points"], axis=0) for name, inputs in objects}
        yield from size_warnings(extents, smallest=2 * widest, largest=opening(hand), hand=hand.name)

    def describe_shard(self, settings: GraspSettings, shard: Shard) -> Iterator[str]:
        """Count the grasps that are kept although no sensor touches."""
        untouched = np.flatnonzero(shard.read("ok")[:, None] & ~shard.read("touch_success").any(axis=-1)) // settings.grasps
        if len(untouched):
            names = [shard.record.rows[row].object_id for row in dict.fromkeys(untouched.tolist())]
            yield (
                f"{pluralise(len(untouched), 'grasp')} of {pluralise(len(names))} ({abbreviate(names)}) kept without any touch: "
                "raise simulate-grasps.attempts"
            )

    def cost(self, settings: GraspSettings) -> Cost:
        """Estimate the attempts: about a dozen unless all are requested, and eight in a hold search, which tests each."""
        holds = settings.search == "hold"
        attempts = settings.attempts if settings.makes_all_attempts else min(settings.attempts, 8 if holds else 12)
        test = {"none": 0.0, "lift": 0.06, "six": 0.3}[settings.test]
        seconds = attempts * (0.06 + 0.02 * settings.plans + test) if holds else 0.05 * attempts + test * settings.grasps
        return Cost(seconds=0.3 + seconds, kilobytes=settings.grasps)

    @contextmanager
    def session(self, settings: GraspSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Prepare the hand and open physics clients, for all objects of a worker."""
        prepared_hand = prepare_hand(settings)
        with ExitStack() as opened:
            yield _Grasping(
                settings,
                prepared_hand,
                pinches=prepare_pinches(prepared_hand) if settings.search == "hold" else None,
                physics=opened.enter_context(Simulation(prepared_hand.hand)),
                test=opened.enter_context(HoldTest(prepared_hand.hand, prepared_hand.sensors, mass=settings.hold_mass))
                if settings.test != "none"
                else None,
            )


@dataclass(frozen=True, eq=False)
class _Grasping:
    """Finds the grasps of one object after the other."""

    settings: GraspSettings
    hand: PreparedHand
    pinches: Pinches | None
    physics: Simulation
    test: HoldTest | None

    def __call__(self, unit: Unit, inputs: Inputs) -> Row:
        """Find the best grasps of an object and return its row."""
        settings, surface = self.settings, inputs["surfaces"]
        mesh = read_mesh(surface)
        prepared_object = prepare_object(mesh, surface["points"], surface["normals"], cell=settings.grid_cell, reach=self.hand.reach)
        self.physics.load(mesh)
        if self.test is not None:
            self.test.load(mesh, prepared_object.points)
        search = GraspSearch(self.hand, prepared_object, self.physics, settings, self._planner(prepared_object, unit))
        kept, touched, faults = self._search(search, unit)
        if len(kept) < settings.grasps:
            most_common_fault = faults.most_common(1)[0][0]
            raise InvalidInput(
                f"{len(kept)} of {settings.grasps} grasps found in {len(touched)} attempts: {most_common_fault}; scale the object "
                f"({', '.join(f'{extent:.3g}' for extent in np.ptp(mesh.vertices, axis=0))} m) to between one and five hands, "
                f"or raise simulate-grasps.attempts"
            )
        stored = [self._stored(grasp) for grasp in kept]
        return {
            "hand_pose": np.stack([grasp.hand_pose for grasp in kept]),
            "pregrasp_angles": np.stack([grasp.pregrasp_angles for grasp in kept]),
            "joint_angles": np.stack([grasp.joint_angles for grasp in kept]),
            "squeeze_angles": np.stack([grasp.squeeze for grasp in stored]),
            "sensor_pose": np.stack([grasp.sensor_pose for grasp in kept]),
            "touch_success": np.stack([grasp.touched for grasp in kept]),
            "contact_point": np.stack([[contact.point if contact else np.zeros(3) for contact in grasp.contacts] for grasp in kept]),
            "contact_normal": np.stack([[contact.normal if contact else np.zeros(3) for contact in grasp.contacts] for grasp in kept]),
            "contact_area": np.stack([grasp.contact_area for grasp in kept]).astype(np.float32),
            "opposition": np.array([grasp.opposition for grasp in kept], np.float32),
            "closure": np.array([grasp.closure for grasp in kept], np.float32),
            "penetration": np.array([grasp.penetration for grasp in kept], np.float32),
            "attempts": np.array(len(touched), np.int32),
            "attempt_success": np.mean(touched, axis=0).astype(np.float32),
            **self._held(kept, stored),
        }

    def _planner(self, prepared_object: PreparedObject, unit: Unit) -> Callable[[np.random.Generator], GraspPlan | None]:
        if self.pinches is None:
            return TouchPlanner(self.hand, prepared_object, self.settings)
        return HoldPlanner.of_object(self.hand, prepared_object, self.settings, self.pinches, unit.rng("simulate-grasps", "rays"))

    def _search(self, search: GraspSearch, unit: Unit) -> tuple[list[Grasp], list[NDArray[np.bool_]], Counter[str]]:
        """Attempt grasps until no better ones are needed; return the best, which sensors touched in each attempt, and counts of faults."""
        settings = self.settings
        kept: list[Grasp] = []
        touched, faults = [], Counter[str]()
        for number in range(SECOND_CHANCES * settings.attempts):
            full = len(kept) == settings.grasps
            if (number >= settings.attempts and (full or not kept)) or (full and self._are_enough(kept)):
                break
            grasp = search.attempt(unit.rng("simulate-grasps", number))
            touched.append(grasp.touched if grasp else np.zeros(len(self.hand.hand.sensors), bool))
            if grasp is None:
                faults[f"the hand has no room around the object with clearance {settings.clearance:g} m"] += 1
            elif grasp.fault is not None:
                faults[grasp.fault] += 1
            if grasp is not None and grasp.sound and settings.search == "hold":
                motions, holds = self._measure(self._stored(grasp), to_end=False)
                grasp = replace(grasp, holds=holds, motions=motions)
            kept = keep_best(kept, grasp, settings.grasps, settings.prefer)
        return kept, touched, faults

    def _are_enough(self, kept: list[Grasp]) -> bool:
        """Check whether the search may end: no attempt can add touches to these grasps or, of a hold search, all of them hold."""
        if self.settings.makes_all_attempts:
            return False
        return all(grasp.holds if self.settings.search == "hold" else grasp.touched.all() for grasp in kept)

    def _stored(self, grasp: Grasp) -> StoredGrasp:
        """Add the squeeze to a grasp: the joint angles at which every sensor presses on."""
        squeeze = pregrasp_angles(self.hand.hand, grasp.joint_angles, [-self.settings.squeeze])[0]
        return StoredGrasp(grasp.hand_pose, grasp.pregrasp_angles, grasp.joint_angles, squeeze, grasp.contacts)

    def _measure(self, grasp: StoredGrasp, *, to_end: bool) -> tuple[NDArray[np.float32], bool]:
        """Measure how far, m, and how fast, m/s, the object moved at the end of the hold test, along one direction after the other.

        Returns
        -------
        motions
            (D, 2); unless `to_end`, up to the first direction in which the grasp does not hold.
        holds
            Whether it holds in all; so does any without a test.
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

    def _held(self, kept: list[Grasp], stored: list[StoredGrasp]) -> Row:
        """Tell which grasps hold, and how the object moved; those that have not passed all directions are tested in every one."""
        if self.test is None:
            return {}
        motions = np.stack(
            [grasp.motions if grasp.holds else self._measure(one, to_end=True)[0] for grasp, one in zip(kept, stored, strict=True)]
        )
        distance, speed = np.moveaxis(motions, -1, 0)
        held = is_held(distance, speed)
        return {
            "held": held[:, HOLD_TESTS[self.settings.test].index(DOWN)],
            "hold_distance": distance,
            "hold_speed": speed,
            **({"held_directions": held} if self.settings.test == "six" else {}),
        }
