"""Measure which grasps of a dataset hold, by common grasp tests, in two physics engines: `python -m benchmarks.held_grasps DATA`.

A grasp holds if the object stays in every direction of a test; `agree` is the share of grasps on which all engines agree.
"""

import argparse
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from benchmarks.grasp_tests import GRASP_TESTS, Engine
from benchmarks.provenance import commit, machine
from benchmarks.timing import Table
from pipeline.dataset.grasps import grasping_hand, grasping_sensors, read_grasps
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.hand.grasp import Grasp, contact_from_depth
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces, ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

HoldResults = dict[tuple[str, Engine], tuple[NDArray[np.bool_], float]]
"""By test and engine: whether each grasp holds, object by object, and processor seconds per grasp."""


def measure(data: Path, tests: Sequence[str], engines: Sequence[Engine], workers: int = 1, each: int | None = None) -> HoldResults:
    """Test the first grasps of every object, by default all, several objects at once."""
    grasps = DataDirectory(data).collection(GRASPS)
    usable = [name for name in grasps if grasps.failure(name) is None]
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        objects = list(pool.map(partial(measure_object, data, tests, engines, each), usable))
    results: HoldResults = {}
    for key in objects[0]:
        held = np.concatenate([of_object[key][0] for of_object in objects])
        results[key] = held, sum(of_object[key][1] * len(of_object[key][0]) for of_object in objects) / len(held)
    return results


def measure_object(data: Path, tests: Sequence[str], engines: Sequence[Engine], each: int | None, object_id: str) -> HoldResults:
    """Test the first stored grasps of one object."""
    surfaces, grasps = (DataDirectory(data).collection(artifact) for artifact in (SURFACES, GRASPS))
    attributes = {"grasps": grasps.first.attributes}
    hand, sensors = grasping_hand(attributes), grasping_sensors(attributes)
    surface = surfaces.view(object_id)
    faces = box_faces(read_mesh(surface).triangles)
    stored = [with_depths(grasp, sensors, faces) for grasp in read_grasps(grasps.view(object_id))[:each]]
    results: HoldResults = {}
    for name in tests:
        for engine in engines:
            with GRASP_TESTS[name].open(engine, hand, sensors) as test:
                test.load(read_mesh(surface), surface["points"].astype(np.float64))
                begin = time.process_time()
                held = np.array([GRASP_TESTS[name].holds(test, grasp) for grasp in stored])
                results[name, engine] = held, (time.process_time() - begin) / len(held)
    return results


def with_depths(grasp: Grasp, sensors: Sequence[Sensor], faces: BoxedFaces) -> Grasp:
    """Add the depths of a stored grasp's contacts, which are not stored."""
    sites = zip(grasp.sensor_pose, sensors, grasp.touched, strict=True)
    contacts = [contact_from_depth(ray_depth(faces, pose, sensor), pose, sensor) if touches else None for pose, sensor, touches in sites]
    return replace(grasp, contacts=contacts)


def table(results: HoldResults, engines: Sequence[Engine]) -> Table:
    """Tabulate shares of grasps."""
    shares = Table("Held grasps", ["grasps", *(f"{engine}: share, s per grasp" for engine in engines), "agree"])
    for name in dict.fromkeys(test for test, _ in results):
        verdicts = np.array([results[name, engine][0] for engine in engines])
        cells = [f"{held.mean():.2f}, {results[name, engine][1]:.2f}" for engine, held in zip(engines, verdicts, strict=True)]
        shares.add(name, verdicts.shape[1], *cells, f"{100 * (verdicts == verdicts[0]).all(axis=0).mean():.1f} %")
    return shares


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--tests", nargs="+", choices=[*GRASP_TESTS], default=[*GRASP_TESTS])
    parser.add_argument("--engines", nargs="+", choices=get_args(Engine), default=get_args(Engine))
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="objects at once")
    arguments = parser.parse_args()
    results = measure(arguments.data, arguments.tests, arguments.engines, arguments.workers)
    print(table(results, arguments.engines).markdown(f"Commit {commit()}, {machine()}; processor seconds."))


if __name__ == "__main__":
    main()
