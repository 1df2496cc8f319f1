"""Grasps: a hand closes around an object in physics."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline.dataset.mesh_rows import mesh_row
from pipeline.engine.stage import Inputs, Unit
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import invalid_entries
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.touch.sensor import Sensor
from vt_pipeline.objects import Source, TouchObject, as_object

POINTS = 10_000  # points of the surface, from which the palm's places are drawn


@dataclass(frozen=True, eq=False)
class Grasps:
    """The best grasps of an object, of G grasps with a hand of J joints and S sensors, the best first.

    Attributes
    ----------
    fingers, sensors
        Names of the fingers' sensors, and the sensors.
    hand_pose
        (G, 4, 4) float64, the hand's root link in the object's frame, m.
    joint_angles
        (G, J) float64, rad; m of a joint that slides.
    sensor_pose
        (G, S, 4, 4) float64, sensor frames in the object's frame, m, for `touch`.
    touched
        (G, S) bool, whether each sensor touches.
    penetration
        (G,) float32, depth of the deepest rigid point in the object, m.
    pregrasp_angles, squeeze_angles
        (G, J) float64, as `joint_angles`: before the fingers close, and what drives them to press.
    held
        (G,) bool, whether the object stays in the hand for a second of gravity; None without `hold_test`, unless `search` is "hold".
    held_directions
        (G, 6) bool, the same with gravity along -x, +x, -y, +y, -z, +z; None but with `hold_test="six"`.
    """

    fingers: tuple[str, ...]
    sensors: tuple[Sensor, ...]
    hand_pose: NDArray[np.float64]
    joint_angles: NDArray[np.float64]
    sensor_pose: NDArray[np.float64]
    touched: NDArray[np.bool_]
    penetration: NDArray[np.float32]
    pregrasp_angles: NDArray[np.float64]
    squeeze_angles: NDArray[np.float64]
    held: NDArray[np.bool_] | None = None
    held_directions: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.hand_pose)

    def __repr__(self) -> str:
        return f"Grasps({len(self)}, {int(self.touched.sum())} of {self.touched.size} sensors touch)"


def grasp(
    object_: TouchObject | Source,
    hand: str | Path = "allegro_right",
    *,
    attempts: int = 50,
    grasps: int = 5,
    seed: int = 0,
    **settings: Any,
) -> Grasps:
    """Search for grasps of an object (supplement 1.3).

    Parameters
    ----------
    object_
        From `load_object`, or what that takes; about as large as the hand can hold, or larger.
    hand
        Name of a shipped hand, or the path of a hand file, which names the sensors that the fingers wear.
    attempts
        Poses of the palm that are tried; up to four times as many where some grasps, but too few, are found.
    grasps
        How many are kept.
    seed
        The same seed gives the same grasps.
    settings
        Further settings of `simulate-grasps`.

    Returns
    -------
    The grasps with most touches.

    Raises
    ------
    InvalidInput
        A setting or the hand file cannot be used, the object has no exterior, or the hand finds too few grasps; the message names the
        remedy.
    """
    from stages.simulate_grasps.stage import GraspSettings, SimulateGrasps

    object_ = as_object(object_)
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise TypeError(f"seed is a whole number, 0 or more; this is {seed!r}")
    try:
        grasp_settings = GraspSettings.model_validate({"hand": str(hand), "attempts": attempts, "grasps": grasps, **settings})
    except ValidationError as error:
        raise InvalidInput(f"grasp: {invalid_entries(error, GraspSettings.model_fields)}") from error
    unit = Unit("object", seed=seed)
    points, normals = sample_exterior(object_.mesh, POINTS, unit.rng("sample-surfaces"))
    surface = {**mesh_row(object_.mesh), "points": points.astype(np.float32), "normals": normals.astype(np.float32)}
    with SimulateGrasps().session(grasp_settings, {}) as process:
        row = process(unit, cast(Inputs, {"surfaces": surface}))
    described = load_hand(hand)
    facts = ("hand_pose", "joint_angles", "sensor_pose", "penetration", "pregrasp_angles", "squeeze_angles", "held", "held_directions")
    arrays: dict[str, Any] = {name: row.get(name) for name in facts}
    sensors = load_worn_sensors(sensor_names(described, grasp_settings.sensor))
    return Grasps(tuple(mount.name for mount in described.sensors), sensors, touched=row["touch_success"], **arrays)
