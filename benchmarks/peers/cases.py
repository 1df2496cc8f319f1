"""Meshes and sensor poses of a dataset, which every peer is given."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

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

    def save(self, path: Path, gel: float) -> None:
        """Write what a peer in another process needs: vertices, faces, poses, and the gel's thickness `w`, m."""
        np.savez(path, vertices=self.mesh.vertices, faces=self.mesh.faces, poses=self.poses, w=gel)


def touched_objects(data: Path) -> list[Case]:
    """Choose the first object of every category of a dataset, each with `POSES` sensors that touch it."""
    directory = DataDirectory(data)
    surfaces, grasps = directory.collection(SURFACES), directory.collection(GRASPS)
    cases: dict[str, Case] = {}
    for object_id in grasps:
        row = grasps.view(object_id)
        touching = row["sensor_pose"][row["touch_success"]] if bool(row["ok"]) else np.empty((0, 4, 4))
        category = str(row["category"])
        if len(touching) < POSES or category in cases:
            continue
        view = surfaces.view(object_id)
        mesh = Mesh.bare(view["meshes/vertices"], view["meshes/faces"])
        cases[category] = Case(object_id, mesh, touching[np.linspace(0, len(touching) - 1, POSES).astype(int)])
    if not cases:
        raise ValueError(f"{data} has no object that {POSES} sensors touch; make it first: make dataset")
    return list(cases.values())
