"""How often sensors touch and how long attempts take: `python -m benchmarks.grasps --objects 3 --attempts 50`.

How sound stored grasps are is measured by `benchmarks.stored_grasps`.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.rng import numpy_rng
from pipeline.toy_objects import CATEGORIES, generate
from stages.simulate_grasps.grasp_search import Grasp, GraspSearch, keep_best
from stages.simulate_grasps.physics import Simulation
from stages.simulate_grasps.prepare import prepare_hand, prepare_object
from stages.simulate_grasps.settings import GraspSettings


@dataclass
class Tally:
    """The grasps of one class of objects."""

    touched: list[NDArray[np.bool_]] = field(default_factory=list)
    kept: list[Grasp] = field(default_factory=list)
    unsound: int = 0
    short: int = 0


def main() -> None:
    """Grasp procedural objects of every class and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=int, default=2, help="of each class")
    parser.add_argument("--attempts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    settings = GraspSettings(attempts=options.attempts)
    start = time.perf_counter()
    prepared_hand = prepare_hand(settings)
    fingers = [mount.name for mount in prepared_hand.hand.sensors]
    print(f"hand prepared in {time.perf_counter() - start:.2f} s")
    tallies = {category: Tally() for category in CATEGORIES}
    seconds, preparing = [], []
    with Simulation(prepared_hand.hand) as physics:
        for category, tally in tallies.items():
            for variant in range(options.objects):
                mesh = normalise_mesh(generate(category, numpy_rng(options.seed, "benchmark", category, variant)), up="z", diagonal=0.5)
                points, normals = sample_exterior(mesh, 10_000, numpy_rng(options.seed, "points", category, variant))
                start = time.perf_counter()
                prepared_object = prepare_object(mesh, points, normals, cell=settings.grid_cell)
                physics.load(mesh)
                preparing.append(time.perf_counter() - start)
                search = GraspSearch(prepared_hand, prepared_object, physics, settings)
                seconds += _grasp(search, tally, (options.seed, category, variant))
    print(
        f"object prepared in {np.mean(preparing):.2f} s; an attempt {1e3 * np.mean(seconds):.0f} ms, 95 % within "
        f"{1e3 * np.percentile(seconds, 95):.0f} ms"
    )
    _print(fingers, tallies)


def _grasp(search: GraspSearch, tally: Tally, identity: tuple[int, str, int]) -> list[float]:
    """Try one object; seconds of each attempt."""
    seconds: list[float] = []
    kept: list[Grasp] = []
    for number in range(search.settings.attempts):
        start = time.perf_counter()
        grasp = search.attempt(numpy_rng(*identity, "attempt", number))
        seconds.append(time.perf_counter() - start)
        tally.touched.append(grasp.touched if grasp else np.zeros(len(search.prepared_hand.hand.sensors), bool))
        tally.unsound += grasp is None or not grasp.sound
        kept = keep_best(kept, grasp, search.settings.grasps)
    tally.short += len(kept) < search.settings.grasps
    tally.kept += kept
    return seconds


def _print(fingers: list[str], tallies: dict[str, Tally]) -> None:
    names = "".join(f"{name:>8}" for name in fingers)
    print(f"{'touches, %':12}{'all':>8}{names}{'kept':>8}{names}{'unsound':>9}{'short':>7}")
    for name, tally in tallies.items():
        print(f"{name:12}{_shares(tally.touched)}{_shares([g.touched for g in tally.kept])}{tally.unsound:9}{tally.short:7}")
    touched = [one for tally in tallies.values() for one in tally.touched]
    kept = [grasp.touched for tally in tallies.values() for grasp in tally.kept]
    print(f"{'together':12}{_shares(touched)}{_shares(kept)}   (the supplement's: 62.7 kept)")
    for label, rows in (("all attempts", touched), ("kept", kept)):
        histogram = np.bincount([int(row.sum()) for row in rows], minlength=len(fingers) + 1) / len(rows)
        print(f"{label + ' with 0 … touches, %':36}" + "".join(f"{100 * part:8.1f}" for part in histogram))


def _shares(rows: list[NDArray[np.bool_]]) -> str:
    table = 100 * np.array(rows)
    return f"{table.mean():8.1f}" + "".join(f"{part:8.1f}" for part in table.mean(axis=0))


if __name__ == "__main__":
    main()
