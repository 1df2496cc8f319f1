"""Touches of the objects of each category, counted."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field, fields

import numpy as np

from pipeline.dataset.object_rows import ObjectRows
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

PAPER = "Smith et al. 2020"
"""The name of the paper and its supplement in tables."""
PAPER_DIAGONAL = 0.5
"""Diagonal to which the paper scales its objects, m."""
SUPPLEMENT_SUCCESS = {"bottle": 71.8, "knife": 54.1, "cellphone": 67.2, "rifle": 53.6, "all": 62.7}
"""Percentage of touches that succeed, from Table 1."""

HOLD_MEASURES = ("contact_area", "opposition", "closure")
"""The arrays that measure how well a grasp holds."""
MOTIONS = ("hold_distance", "hold_speed")
"""The arrays that measure how the object moves in the hold test."""


@dataclass
class Tally:
    """Touches of the objects of one category: lists with an entry per object, empty where something was not measured."""

    touched: list[np.ndarray] = field(default_factory=list)  # (grasp, sensor) bool: which touches of the kept grasps succeed
    tried: list[np.ndarray] = field(default_factory=list)  # (sensor,) the share of all attempts in which a sensor touched
    # (grasp, 3) area of contact, mm², greatest angle between two contacts, degrees, and margin of force closure
    hold_measures: list[np.ndarray] = field(default_factory=list)
    held: list[np.ndarray] = field(default_factory=list)  # (grasp,) bool: which grasps hold it in the hold test
    held_directions: list[np.ndarray] = field(default_factory=list)  # (grasp, 6) bool: the same by the direction of gravity
    motions: list[np.ndarray] = field(default_factory=list)  # (grasp, direction, 2) how far, m, and how fast, m/s, it moved in the end
    diagonals: list[float] = field(default_factory=list)  # of the bounding box, m

    @classmethod
    def joined(cls, tallies: Iterable["Tally"]) -> "Tally":
        """Put the objects of several categories together."""
        parts = list(tallies)
        return cls(*([value for part in parts for value in getattr(part, entry.name)] for entry in fields(cls)))

    def part(self, numbers: Iterable[int]) -> "Tally":
        """Select objects by their numbers."""
        indices = list(numbers)
        return Tally(*([values[index] for index in indices] if (values := getattr(self, entry.name)) else [] for entry in fields(self)))

    def row(self) -> tuple[int, int, int, float, float]:
        """Count objects, grasps and touches; give the percentages that succeed of those kept, and of attempts (mean over objects)."""
        touched = np.concatenate(self.touched)
        return len(self.touched), len(touched), touched.size, 100 * touched.mean(), 100 * float(np.mean(self.tried))


def tally(data: Location) -> dict[str, Tally]:
    """Count the touches of every category in a data directory, of objects that did not fail."""
    shard = DataDirectory(data).collection(GRASPS).first
    measured = HOLD_MEASURES if shard.has("closure") else ()  # older datasets have none
    tested = tuple(name for name in ("held", "held_directions", *MOTIONS) if shard.has(name))
    arrays = ["touch_success", "attempt_success", *measured, *tested]
    rows = ObjectRows(data, arrays, split=None)
    tallies: dict[str, Tally] = defaultdict(Tally)
    for object_id, category in zip(rows.object_ids, rows.categories, strict=True):
        entry = tallies[category]
        entry.touched.append(rows.read("touch_success", object_id))
        entry.tried.append(rows.read("attempt_success", object_id))
        if measured:
            area, angle, margin = (rows.read(name, object_id) for name in HOLD_MEASURES)
            entry.hold_measures.append(np.stack([1e6 * area.sum(axis=1), angle, margin], axis=1))
        if tested:
            entry.held.append(rows.read("held", object_id))
            entry.diagonals.append(rows.diagonal(object_id))
        if "held_directions" in tested:
            entry.held_directions.append(rows.read("held_directions", object_id))
        if MOTIONS[0] in tested:  # older datasets have none
            entry.motions.append(np.stack([rows.read(name, object_id) for name in MOTIONS], axis=-1))
    return dict(sorted(tallies.items()))


def has_paper_sizes(data: Location) -> bool:
    """Check whether every object was scaled to the paper's diagonal: only then can figures in metres be compared with the paper's."""
    shard = DataDirectory(data).collection(SURFACES).first
    if shard.attributes.get("settings", {}).get("diagonal", PAPER_DIAGONAL) != PAPER_DIAGONAL:
        return False
    if not shard.has("metres_per_unit"):  # older datasets keep no real sizes
        return True
    rows = ObjectRows(data, ["metres_per_unit"], split=None)
    return all(rows.read("metres_per_unit", object_id) == 0 for object_id in rows.object_ids)


def sensors_of(data: Location) -> list[str]:
    """Read the names of the sensors, in their order."""
    return [str(name) for name in DataDirectory(data).collection(GRASPS).first.read("sensor")]
