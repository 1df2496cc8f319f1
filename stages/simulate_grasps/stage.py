"""Supplement 1.3: the hand is set on the object at random, its fingers close, contact settles; the best grasps are kept."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from pipeline.config.settings import ObjectSettings, defining, described_by, setting
from pipeline.console import abbreviate, pluralise
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Trade, Unit
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files, sensor_names
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

MAX_ATTEMPTS_FACTOR = 4  # times `attempts`, after which the search for an object with some sound grasps, but not enough, is given up


class HandSettings(ObjectSettings):
    """A hand, and how its grasps are measured."""

    stage: ClassVar[str] = "simulate-grasps"  # as messages name it

    hand: Annotated[str, described_by("hand")] = defining(
        "allegro_right", "the supplement's hand; another is another hand file, by name or by path ending in .yaml"
    )
    sensor: Annotated[str, described_by("sensor")] | None = defining(
        None, "null: the sensors that the hand file names; another sensor file, by name or path, is for all fingers"
    )
    settle_steps: int = setting(400, "steps of 1/240 s in which contact must settle; otherwise the attempt fails", ge=20)
    penetration_limit: float = defining(0.001, "m that a rigid link may penetrate the object in a kept grasp", ge=0)
    hold_test: Literal["none", "lift", "six"] | None = defining(
        None,
        "lift: the object is freed in the grasp, and must rest in the hand after a second of gravity; six: along ± x, ± y and ± z in turn, "
        "in six times the time; it is recorded, and simulate-grasps.search=hold keeps what passes; null: lift for that, else none",
    )
    hold_mass: float = setting(
        0.2, "kg of any object in the hold test, spread evenly over its surface: a full glass; with 1 kg few grasps hold", gt=0, le=1000
    )
    squeeze: float = defining(0.002, "m that sensors press beyond the grasp in `squeeze_angles`, to which motors drive in hold tests", ge=0)

    @property
    def test(self) -> Literal["none", "lift", "six"]:
        """The hold test, with its default."""
        return self.hold_test or "none"


class GraspSettings(HandSettings):
    """How grasps are searched (supplement 1.3)."""

    grasps: int = defining(5, "the best five are kept (supplement 1.3)", ge=1)
    search: Literal["touch", "hold"] = defining(
        "touch",
        "touch: the supplement's (1.3), palms tangent to the object at random, as many touches as possible; hold: gels on opposed points, "
        "contacts that carry the object, kept if it stays in the hand",
    )
    plans: int = setting(2, "plans that a hold search makes per attempt; physics gets the best", ge=1)
    spread: float = setting(
        0.05, "m from the centre of mass at which a hold search pinches a quarter as often as at the centre: more covers long objects", gt=0
    )
    prefer: Literal["touches", "area", "closure"] = defining(
        "touches",
        "the supplement's rule (1.3); area: most area of contact; closure: the greatest margin of force closure, then most touches; "
        "both make all attempts",
    )
    attempts: int = setting(
        50,
        "poses of the palm tried per object, as many as the authors' later simulator tries, and up to four times as many where too few "
        "grasps are sound; 12 leave 4 % of the sensors untouched",
        ge=1,
    )
    exhaustive: bool = setting(
        False,
        "make all attempts, for their statistics; else a touch search ends once no attempt could add a touch, with the same grasps in a "
        "third of the time, and a hold search once all grasps hold",
    )
    least_distance: float = setting(0.005, "m from object to palm at least: nearer, the thumb is in the way; 30 mm touches as often", ge=0)
    greatest_distance: float = setting(0.06, "m from object to palm at most: up to 100 mm 70 % of all sensors touch instead of 76", gt=0)
    ik_samples: int = setting(
        1024, "joint vectors per finger that inverse kinematics chooses among: 256, 1024, 2048 touch with 72, 76, 80 % of sensors", ge=64
    )
    ik_refinements: int = setting(3, "rounds of local search around the best: 0, 1, 3, 5 touch with 52, 68, 76, 79 % of all sensors", ge=0)

    @property
    def test(self) -> Literal["none", "lift", "six"]:
        """The hold test, with its default."""
        return self.hold_test or ("lift" if self.search == "hold" else "none")

    @property
    def makes_all_attempts(self) -> bool:
        """Whether no grasp ends the search early: areas and margins have no greatest value at which it could end."""
        return self.exhaustive or self.prefer != "touches"

    @model_validator(mode="after")
    def _check_ranges(self) -> "GraspSettings":
        if self.least_distance > self.greatest_distance:
            raise ValueError(f"least_distance {self.least_distance} m is above greatest_distance {self.greatest_distance} m")
        if self.grasps > (limit := MAX_ATTEMPTS_FACTOR * self.attempts):
            raise ValueError(
                f"{self.grasps} grasps need more than {self.attempts} attempts, which yield at most {limit}; ask for fewer grasps, or for "
                f"at least {-(-self.grasps // MAX_ATTEMPTS_FACTOR)} attempts"
            )
        return self


class GraspStage(ObjectStage):
    """A stage that makes `grasps`: what it says of the hand."""

    output = GRASPS

    def inputs(self, settings: Any) -> tuple[Artifact, ...]:
        return (SURFACES,)

    def assets(self, settings: Any) -> list[Path]:
        """List the hand file with all it names, and the sensor files."""
        hand = load_hand(settings.hand)
        return [*hand.files, *sensor_files([settings.sensor] if settings.sensor else sensor_names(hand))]

    def constants(self, settings: Any) -> Row:
        """Name grasps, sensors and joints, for later stages' arrays too."""
        hand = load_hand(settings.hand)
        sensors = np.array([mount.name for mount in hand.sensors])
        return {"grasp": np.arange(settings.grasps, dtype=np.int32), "sensor": sensors, "joint": np.array(hand.joint_names)}

    def attributes(self, settings: Any) -> dict[str, Any]:
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

    def hand_notes(self, settings: Any) -> Iterator[str]:
        """Name links whose mass or inertia is estimated, and sensors that are not on the surface of their links."""
        from pipeline.kernels.hand.sensor_mounts import misplaced_sensors
        from pipeline.physics.hand_urdf import inertia_notes

        hand = load_hand(settings.hand)
        yield from (f"hand {hand.name}: {note}" for note in inertia_notes(hand))
        sensors = load_worn_sensors(sensor_names(hand, settings.sensor))
        yield from (f"hand {hand.name}: {sentence}" for _, sentence in misplaced_sensors(hand, sensors))


class SimulateGrasps(GraspStage):
    """From an object's surface to the poses of the hand and its sensors around it."""

    name = "simulate-grasps"
    summary = "Simulate grasps; keep the best and record which sensors touch."
    settings_type = GraspSettings

    def describe_misfits(self, settings: GraspSettings, objects: Iterable[tuple[str, Inputs]]) -> Iterator[str]:
        """Name links whose mass or inertia is estimated, sensors off the surface of their links, and objects that do not fit the hand."""
        from pipeline.kernels.hand.kinematics import opening

        yield from self.hand_notes(settings)
        hand = load_hand(settings.hand)
        sensors = load_worn_sensors(sensor_names(hand, settings.sensor))
        smallest, largest = 2 * max(sensor.width for sensor in sensors), opening(hand)
        extents = {name: np.ptp(inputs["surfaces"]["points"], axis=0) for name, inputs in objects}
        small = [name for name, sides in extents.items() if sides.max() < smallest]
        large = [name for name, sides in extents.items() if sides.min() > largest]
        for names, fault in (
            (small, f"smaller than two sensors of {hand.name} side by side, {1e3 * smallest:.0f} mm"),
            (large, f"wider on every side than {hand.name} opens, {1e3 * largest:.0f} mm, so that fingers touch one side only, if any"),
        ):
            if names:
                yield f"{pluralise(len(names))} {fault} ({abbreviate(names)}): is the unit right?"

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

    def session(self, settings: GraspSettings, models: Mapping[str, Path]) -> AbstractContextManager[Callable[[Unit, Inputs], Row]]:
        """Prepare the hand and open physics clients, for all objects of a worker."""
        from stages.simulate_grasps.grasp_search import grasping

        return grasping(settings)


def missing_touches(data: Path, reference: Path) -> dict[str, float]:
    """Compute the share of the sensors of all kept grasps that do not touch, % by object."""
    rows = ObjectRows(data, ("touch_success",), split=None)
    return {name: 100 * (1 - float(rows.read("touch_success", name).mean())) for name in rows.object_ids}


def sensors_of_grasps(data: Path) -> int:
    """Count the sensors of the kept grasps of an object."""
    rows = ObjectRows(data, ("touch_success",), split=None)
    return rows.read("touch_success", rows.object_ids[0]).size


TRADE = Trade(
    metric="sensors of kept grasps that do not touch",
    unit="%",
    candidates=(
        {"ik_samples": 256, "ik_refinements": 0},
        {"ik_samples": 256},
        {"ik_refinements": 1},
        {"attempts": 10},
        {"ik_samples": 2048},
    ),
    errors=missing_touches,
    trials=sensors_of_grasps,
)
