"""Touches of the objects of each category, counted."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

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


LISTS = ("touched", "tried", "hold_measures", "held", "held_directions", "motions", "diagonals")
"""Fields of a `Tally` with an entry per object."""


@dataclass
class Tally:
    """Touches of the objects of one category."""

    touched: list[np.ndarray] = field(default_factory=list)
    """(grasp, sensor) bool of every object: which touches of the kept grasps succeed."""
    tried: list[np.ndarray] = field(default_factory=list)
    """(sensor,) of every object: the share of all attempts in which a sensor touched."""
    hold_measures: list[np.ndarray] = field(default_factory=list)
    """(grasp, 3) of every object: area of contact, mm², greatest angle between two contacts, degrees, and margin of force closure."""
    held: list[np.ndarray] = field(default_factory=list)
    """(grasp,) bool of every object: which grasps hold it in the hold test; empty without the test."""
    held_directions: list[np.ndarray] = field(default_factory=list)
    """(grasp, 6) bool of every object: the same by the direction of gravity; empty if only one was tested."""
    motions: list[np.ndarray] = field(default_factory=list)
    """(grasp, direction, 2) of every object: how far, m, and how fast, m/s, it moved at the end of the hold test; empty without."""
    diagonals: list[float] = field(default_factory=list)
    """Diagonal of every object's bounding box, m; empty without a hold test."""

    @classmethod
    def joined(cls, tallies: Iterable[Tally]) -> Tally:
        """Put the objects of several categories together."""
        joined = cls()
        for part in tallies:
            for name in LISTS:
                getattr(joined, name).extend(getattr(part, name))
        return joined

    def part(self, numbers: Iterable[int]) -> Tally:
        """Select objects by their numbers."""
        indices, subset = list(numbers), Tally()
        for name in LISTS:
            if values := getattr(self, name):
                getattr(subset, name).extend(values[index] for index in indices)
        return subset

    def row(self) -> tuple[int, int, int, float, float]:
        """Count objects, grasps and touches; give the percentages that succeed of those kept, and of attempts (mean over objects)."""
        touched = np.concatenate(self.touched)
        return len(self.touched), len(touched), touched.size, 100 * touched.mean(), 100 * float(np.mean(self.tried))


def tally(data: Location) -> dict[str, Tally]:
    """Count the touches of every category in a data directory; failed objects are left out."""
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
