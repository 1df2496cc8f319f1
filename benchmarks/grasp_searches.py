"""Measure searches for grasps side by side: `python -m benchmarks.grasp_searches DATA search=touch search=hold`.

DATA is a dataset. Each further argument is a search: settings of `simulate-grasps`, joined by commas. Nothing is stored.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from benchmarks.provenance import commit, machine
from benchmarks.timing import Table
from pipeline.engine.unit import Unit
from pipeline.errors import InvalidInput
from pipeline.store.directory import DataDirectory
from pipeline.store.rows import Row
from schemas.surfaces import SURFACES
from stages.registry import resolve
from stages.simulate_grasps.stage import GraspSettings, SimulateGrasps

STAGE = SimulateGrasps.name
REACHED = 0.02
"""m from a contact within which the surface counts as covered."""


def measure(data: Path, searches: Sequence[str], object_ids: Sequence[str] = ()) -> Table:
    """Search for grasps of every object with each group of settings; an object that fails is counted and left out."""
    table = Table("Searches for grasps", ["objects", "with all held", "% held", "touches", "attempts", "s per object", "covered, %"])
    surfaces = DataDirectory(data).collection(SURFACES)
    names = [name for name in object_ids or surfaces if surfaces.failure(name) is None]
    for search in searches:
        settings = resolve(STAGE, "draft", [f"{STAGE}.hold_test=lift", *(f"{STAGE}.{text}" for text in search.split(","))])
        assert isinstance(settings, GraspSettings)
        rows: dict[str, Row] = {}
        with SimulateGrasps().session(settings, {}) as process:
            with suppress(InvalidInput):
                process(Unit(names[0]), {"surfaces": surfaces.view(names[0])})  # compiles
            begin = time.process_time()
            for name in names:
                try:
                    rows[name] = process(Unit(name), {"surfaces": surfaces.view(name)})
                except InvalidInput as error:
                    print(f"{search}: {name}: {error}")
            seconds = (time.process_time() - begin) / len(names)
        held = np.array([row["held"] for row in rows.values()])
        share = np.mean([covered(surfaces.view(name)["points"], row) for name, row in rows.items()])
        touches = np.mean([row["touch_success"].sum(axis=1) for row in rows.values()])
        attempts = np.mean([row["attempts"] for row in rows.values()])
        table.add(
            search,
            f"{len(rows)} of {len(names)}",
            int(held.all(axis=1).sum()),
            f"{100 * held.mean():.1f}",
            f"{touches:.2f}",
            f"{attempts:.1f}",
            f"{seconds:.2f}",
            f"{100 * share:.0f}",
        )
    return table


def covered(points: np.ndarray, row: Row) -> float:
    """Compute the share of an object's surface points (N, 3) that are near a contact of a kept grasp."""
    contacts = row["contact_point"][row["contact_area"] > 0]
    return float((KDTree(contacts).query(points)[0] <= REACHED).mean()) if len(contacts) else 0.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("searches", nargs="+", help="settings of simulate-grasps, joined by commas")
    parser.add_argument("--objects", nargs="+", default=[], help="by default all")
    arguments = parser.parse_args()
    table = measure(arguments.data, arguments.searches, arguments.objects)
    print(table.markdown(f"Commit {commit()}, {machine()}; processor seconds; covered: within {1e2 * REACHED:g} cm of a contact."))


if __name__ == "__main__":
    main()
