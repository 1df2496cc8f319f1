"""The settings of `simulate-grasps`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from pipeline.config.settings import ObjectSettings, described_by, setting

SECOND_CHANCES = 4
"""Factor of `attempts` after which the search for an object with some sound grasps, but not enough, is given up."""


class GraspSettings(ObjectSettings):
    """How grasps are found (supplement 1.3)."""

    hand: Annotated[str, described_by("hand")] = setting(
        "allegro_right", "the supplement's hand; another is another hand file, by name or by path ending in .yaml", changes="definition"
    )
    sensor: Annotated[str, described_by("sensor")] | None = setting(
        None,
        "each finger's as the hand file says; another, on all fingers, is another sensor file, by name or by path ending in .yaml",
        changes="definition",
    )
    grasps: int = setting(5, "the best five are kept (supplement 1.3)", ge=1, changes="definition")
    search: Literal["touch", "hold"] = setting(
        "touch",
        "the supplement's (1.3): palms tangent to the object at random, as many touches as can be; hold: gels on opposed points, contacts "
        "that carry the object, kept if it stays in the hand",
        changes="definition",
    )
    plans: int = setting(2, "plans that a hold search makes for one attempt; physics gets the best", ge=1)
    spread: float = setting(
        0.05, "m from the centre of mass at which a hold search pinches a quarter as often as at the centre: more covers long objects", gt=0
    )
    prefer: Literal["touches", "area", "closure"] = setting(
        "touches",
        "the supplement's rule (1.3); area: most area of contact; closure: the greatest margin of force closure, then most touches; "
        "both make all attempts",
        changes="definition",
    )
    attempts: int = setting(
        50,
        "poses of the palm tried per object, as many as the authors' later simulator tries, and up to four times as many where some grasps "
        "but too few hold; 12 leave 4 % of the sensors untouched",
        ge=1,
    )
    exhaustive: bool = setting(
        False,
        "make all attempts, for their statistics; else a touch search ends once no attempt could add a touch, with the same grasps in a "
        "third of the time, and a hold search once all grasps hold",
    )
    least_distance: float = setting(
        0.005, "m from object to palm at least: nearer, the thumb's base is in the way; 30 mm touches as often", ge=0
    )
    greatest_distance: float = setting(0.06, "m from object to palm at most: up to 100 mm 70 % of all sensors touch instead of 76", gt=0)
    ik_samples: int = setting(
        1024,
        "joint vectors per finger that the inverse kinematics chooses among: 256, 1024, 2048 touch with 72, 76, 80 % of all sensors",
        ge=64,
    )
    ik_refinements: int = setting(
        3, "rounds of local search around the best of them: 0, 1, 3, 5 touch with 52, 68, 76, 79 % of all sensors", ge=0
    )
    clearance: float = setting(
        0.001,
        "m that rigid links are asked to keep from the object: 2 mm costs 4 % of the touches, under 1 mm contact begins to push",
        ge=0,
    )
    opening: float = setting(
        0.006, "m that every sensor is drawn back before it closes: about a gel's thickness; 0 and 12 mm touch as often", ge=0
    )
    settle_steps: int = setting(400, "steps of 1/240 s that contact may take to settle; what has not is no grasp", ge=20)
    resting_speed: float = setting(
        2e-3, "rad/s below which a joint rests, a tenth of it in m/s where it slides: at most 1 µm of the sensor's way in one step", gt=0
    )
    penetration_limit: float = setting(
        0.001, "m that a rigid link may penetrate the object in a grasp that is kept", ge=0, changes="definition"
    )
    grid_cell: float = setting(
        0.005,
        "m, side of a cell of the distance grid, or of one of 6 million cells where that is larger: 2.5 mm finds no more and takes half as "
        "long again, with 10 mm one link was 0.2 mm deep",
        ge=1e-5,
        le=1,
    )

    hold_test: Literal["none", "lift", "six"] | None = setting(
        None,
        "lift: the object is freed in the grasp, and must rest in the hand after a second of gravity; six: along ± x, ± y and ± z in turn, "
        "in six times the time; by default none for search touch, where it is recorded only, and lift for hold, which keeps what passes",
        changes="definition",
    )
    hold_mass: float = setting(
        0.2, "kg of any object in the hold test, spread evenly over its surface: a full glass; with 1 kg few grasps hold", gt=0, le=1000
    )
    squeeze: float = setting(
        0.002,
        "m that every sensor presses on beyond the grasp in `squeeze_angles`, to which the motors drive in the hold test",
        ge=0,
        changes="definition",
    )

    @property
    def test(self) -> Literal["none", "lift", "six"]:
        """The hold test, with its default."""
        return self.hold_test or ("lift" if self.search == "hold" else "none")

    @property
    def makes_all_attempts(self) -> bool:
        """Check whether no grasp ends the search early: areas and margins have no greatest value at which it could end."""
        return self.exhaustive or self.prefer != "touches"

    @model_validator(mode="after")
    def _distances_are_in_order(self) -> GraspSettings:
        if self.least_distance > self.greatest_distance:
            raise ValueError(f"least_distance {self.least_distance} m is above greatest_distance {self.greatest_distance} m")
        return self

    @model_validator(mode="after")
    def _attempts_are_enough(self) -> GraspSettings:
        if self.grasps > (limit := SECOND_CHANCES * self.attempts):
            raise ValueError(
                f"{self.grasps} grasps need more than {self.attempts} attempts, which yield at most {limit}; ask for fewer grasps, or for "
                f"at least {-(-self.grasps // SECOND_CHANCES)} attempts"
            )
        return self
