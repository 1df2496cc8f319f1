"""The knobs of `simulate-grasps`."""

from __future__ import annotations

from pipeline.settings import Settings, knob


class GraspSettings(Settings):
    """How grasps are found (supplement 1.3)."""

    hand: str = knob("allegro_right", "the supplement's hand; another is another hand file, by name or by path ending in .yaml")
    grasps: int = knob(5, "the best five are kept (supplement 1.3)", ge=1)
    attempts: int = knob(50, "placements tried an object; `peers.md`'s authors try 50 as well", ge=1)
    exhaustive: bool = knob(
        True,
        "make all attempts, for their statistics; False stops once no further attempt could be kept, with the same grasps",
    )
    least_distance: float = knob(0.005, "m from object to palm at least: nearer, the thumb's base stands in most objects", ge=0)
    greatest_distance: float = knob(0.06, "m from object to palm at most: further, curled fingers reach past it", gt=0)
    ik_samples: int = knob(1024, "joint vectors a finger that the inverse kinematics chooses among; a power of 2 spreads best", ge=64)
    ik_refinements: int = knob(3, "rounds of local search around the best of them; a fourth gains nothing", ge=0)
    clearance: float = knob(0.001, "m that rigid links are asked to keep from the object: what physics keeps, too", ge=0)
    opening: float = knob(0.006, "m that every sensor is drawn back before it closes: about a gel's thickness", ge=0)
    settle_steps: int = knob(400, "steps of 1/240 s that contact may take to settle; what has not is no grasp", ge=20)
    resting_speed: float = knob(2e-3, "rad/s below which a joint rests: 10 µm in one step at the sensor", gt=0)
    penetration_limit: float = knob(0.001, "m that a rigid part may stand inside the object in a grasp that is kept", ge=0)
    grid_cell: float = knob(0.0025, "m a cell of the distance grid: half of what separates a touch from none", gt=0)
