"""Time one grasp attempt, physics included. For touches see `vt-pipeline summary`, for penetration `benchmarks.stored_grasps`."""

from pathlib import Path

from benchmarks.cases import touched_objects
from benchmarks.timing import Table, over_items, side_by_side
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.physics.simulation import Simulation
from pipeline.rng import numpy_rng
from stages.simulate_grasps.grasp_search import GraspSearch
from stages.simulate_grasps.prepare import prepare_hand, prepare_object
from stages.simulate_grasps.stage import GraspSettings
from stages.simulate_grasps.touch_plan import TouchPlanner

ATTEMPTS = 10


def measure(data: Path, turns: int) -> Table:
    """Measure the same `ATTEMPTS` attempts of each case, `turns` rounds."""
    table = Table("Grasps", ["ms per attempt"], [f"{ATTEMPTS} attempts per object, processor milliseconds, least / median."])
    settings = GraspSettings()
    prepared_hand = prepare_hand(settings)
    with Simulation(prepared_hand.hand) as physics:
        for case in touched_objects(data):
            points, normals = sample_exterior(case.mesh, 10_000, numpy_rng(0, "points"))
            physics.load(case.mesh)
            prepared_object = prepare_object(case.mesh, points, normals, reach=prepared_hand.reach)
            search = GraspSearch(prepared_hand, prepared_object, physics, settings, TouchPlanner(prepared_hand, prepared_object, settings))
            attempts = over_items(lambda number, s=search: s.attempt(numpy_rng(0, "attempt", number)), range(ATTEMPTS))
            table.add(case.name, side_by_side({"": attempts}, turns)[""])
    return table
