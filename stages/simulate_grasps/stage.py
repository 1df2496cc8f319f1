"""Supplement 1.3: the hand is set on the object at random, its fingers close, contact settles; the best grasps are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import abbreviate
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.physics_urdf import links_without_mass
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files, sensor_names
from pipeline.physics.hold_test import HoldTest
from pipeline.physics.simulation import Simulation
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from stages.simulate_grasps.grasp_search import Grasp, GraspSearch, keep_best
from stages.simulate_grasps.prepare import PreparedHand, prepare_hand, prepare_object
from stages.simulate_grasps.settings import GraspSettings
from stages.simulate_grasps.size_warnings import opening, size_warnings

SECOND_CHANCES = 4
"""Times `attempts` after which an object that has yielded some sound grasps, but not enough, is given up."""
STAYS = 0.1
"""m that a lifted object's centre may move: one that slides or tilts less lies in the hand; one that falls moves so far in 0.14 s."""


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
        """Labels of grasps, sensors and joints, which later stages' arrays take over."""
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

    def warnings(self, settings: GraspSettings, objects: Iterable[tuple[str, Inputs]]) -> Iterator[str]:
        """Name links without mass, and objects that do not fit the hand."""
        hand = load_hand(settings.hand)
        if massless := links_without_mass(hand):
            yield f"hand {hand.name}: its URDF states no mass for {abbreviate(massless)}; estimated from collision shapes at 1000 kg/m³"
        widest = max(sensor.width for sensor in load_worn_sensors(sensor_names(hand, settings.sensor)))
        extents = {name: np.ptp(inputs["surfaces"]["points"], axis=0) for name, inputs in objects}
        yield from size_warnings(extents, smallest=2 * widest, largest=opening(hand), hand=hand.name)

    def cost(self, settings: GraspSettings) -> Cost:
        """Mostly attempts, of about 0.08 s each; some dozen are enough where not all are asked for."""
        attempts = settings.attempts if settings.exhaustive else min(settings.attempts, 12)
        lifts = 0.05 * settings.grasps if settings.lift_test else 0
        return Cost(seconds=0.3 + 0.08 * attempts + lifts, kilobytes=settings.grasps)

    @contextmanager
    def session(self, settings: GraspSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Prepare the hand and open a physics client, for all objects of a worker."""
        prepared_hand = prepare_hand(settings)
        with ExitStack() as opened:
            physics = opened.enter_context(Simulation(prepared_hand.hand))
            lift = HoldTest(prepared_hand.hand, prepared_hand.sensors, mass=settings.lift_mass) if settings.lift_test else None
            if lift is not None:
                opened.enter_context(lift)
            yield lambda unit, inputs: _grasp(prepared_hand, physics, lift, settings, unit, inputs)


def _grasp(
    prepared_hand: PreparedHand, physics: Simulation, lift: HoldTest | None, settings: GraspSettings, unit: Unit, inputs: Inputs
) -> Row:
    surface = inputs["surfaces"]
    mesh = read_mesh(surface)
    prepared_object = prepare_object(mesh, surface["points"], surface["normals"], cell=settings.grid_cell, reach=prepared_hand.reach)
    physics.load(mesh)
    search = GraspSearch(prepared_hand, prepared_object, physics, settings)
    kept: list[Grasp] = []
    touched = []
    for number in range(SECOND_CHANCES * settings.attempts):
        if number >= settings.attempts and (not kept or len(kept) == settings.grasps):
            break
        first_are_best = settings.prefer == "touches" and not settings.exhaustive
        if first_are_best and len(kept) == settings.grasps and all(grasp.touched.all() for grasp in kept):
            break
        grasp = search.attempt(unit.rng("simulate-grasps", number))
        touched.append(grasp.touched if grasp else np.zeros(len(prepared_hand.hand.sensors), bool))
        kept = keep_best(kept, grasp, settings.grasps, settings.prefer)
    if len(kept) < settings.grasps:
        raise InvalidInput(
            f"{len(kept)} of {settings.grasps} grasps found in {len(touched)} attempts: the hand has no room around the object "
            f"({', '.join(f'{extent:.3g}' for extent in np.ptp(mesh.vertices, axis=0))} m); scale it to between one and five hands, "
            f"or raise simulate-grasps.attempts"
        )
    held: Row = {}
    if lift is not None:
        lift.load(mesh, prepared_object.points)
        motions = [lift.hold(grasp.hand_pose, grasp.joint_angles, grasp.contacts, limit=STAYS) for grasp in kept]
        held["held"] = np.array([motion.moved <= STAYS for motion in motions])
    return {
        "hand_pose": np.stack([grasp.hand_pose for grasp in kept]),
        "joint_angles": np.stack([grasp.joint_angles for grasp in kept]),
        "sensor_pose": np.stack([grasp.sensor_pose for grasp in kept]),
        "touch_success": np.stack([grasp.touched for grasp in kept]),
        "contact_area": np.stack([grasp.contact_area for grasp in kept]).astype(np.float32),
        "opposition": np.array([grasp.opposition for grasp in kept], np.float32),
        "closure": np.array([grasp.closure for grasp in kept], np.float32),
        "penetration": np.array([grasp.penetration for grasp in kept], np.float32),
        "attempts": np.array(len(touched), np.int32),
        "attempt_success": np.mean(touched, axis=0).astype(np.float32),
        **held,
    }
