"""Meshes of a dataset and sensors that touch them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Round, over_items
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

POSES = 5
"""Sensors per object, spread over its grasps and fingers."""


@dataclass(frozen=True)
class Case:
    """An object and sensors that touch it: `poses` (K, 4, 4) float64, sensor frame to world frame."""

    name: str
    mesh: Mesh
    poses: NDArray[np.float64]


def touched_objects(data: Path) -> list[Case]:
    """Choose the first object of every category of a dataset that `POSES` sensors touch."""
    directory = DataDirectory(data)
    surfaces, grasps = directory.collection(SURFACES), directory.collection(GRASPS)
    cases: dict[str, Case] = {}
    for object_id in grasps:
        row = grasps.view(object_id)
        touching = row["sensor_pose"][row["touch_success"]] if bool(row["ok"]) else np.empty((0, 4, 4))
        category = str(row["category"])
        if len(touching) >= POSES and category not in cases:
            poses = touching[np.linspace(0, len(touching) - 1, POSES).astype(int)]
            cases[category] = Case(object_id, read_mesh(surfaces.view(object_id)), poses)
    if not cases:
        raise SystemExit(f"{data} has no object that {POSES} sensors touch; make it first: make dataset")
    return list(cases.values())


def over_cases(cases: Sequence[Case], call: Callable[[int, NDArray[np.float64]], object]) -> Round:
    """Make a round over all sensors of all cases; `call` takes a case's number and a pose."""
    return over_items(lambda item: call(*item), [(number, pose) for number, case in enumerate(cases) for pose in case.poses])
