"""Measure closed meshes of test objects: `python -m benchmarks.closed_surfaces DATA CONFIGURATION --resolution 128`."""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import igl
import numpy as np
import trimesh

from benchmarks.timing import Table, three_digits
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.metrics.surface_quality import intersection_over_union
from pipeline.models.reconstruction import close_reconstruction
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES

POINTS = 20_000
"""Random points in the box around an object and its reconstruction, for their intersection over union."""


def main() -> None:
    """Print a table of all test objects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("configuration")
    parser.add_argument("--resolution", type=int, default=128, help="edges along the longest side, 64 or more")
    arguments = parser.parse_args()
    surfaces = DataDirectory(arguments.data).collection(SURFACES)
    names = ObjectRows(arguments.data, ["points"], "test").object_ids
    rows: list[Any] = [
        measure(arguments.data, arguments.configuration, name, arguments.resolution, read_mesh(surfaces.view(name))) for name in names
    ]
    table = Table(f"{arguments.resolution} edges", ["processor s", "watertight", "parts", "touch charts within, mm", "IoU"])
    for name, row in [*zip(names, rows, strict=True), ("mean", np.mean(rows, axis=0)), ("most", np.max(rows, axis=0))]:
        table.add(name, *map(three_digits, row))
    print(table.markdown(""))


def measure(data: Path, configuration: str, name: str, resolution: int, truth: Mesh) -> tuple[float, ...]:
    """Close one reconstruction, and compare what other programs read of it with its touch charts and the object."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "closed.glb"
        prediction = predict(
            path, StoredGrasps(data, name), PredictOptions(data / "models", configuration, resolution=resolution), "closed"
        )
        mesh = trimesh.load_scene(path).to_mesh()  # equal vertices become one
    began = time.process_time()
    close_reconstruction(prediction.reconstruction, resolution)
    seconds = time.process_time() - began
    vertices, faces = np.ascontiguousarray(mesh.vertices[:, [0, 2, 1]] * [1, -1, 1]), np.asarray(mesh.faces)  # glTF is y up
    touch_vertices = np.asarray(prediction.reconstruction.vertices[prediction.reconstruction.vision :])
    farthest = np.sqrt(igl.point_mesh_squared_distance(touch_vertices, vertices, faces)[0]).max() if len(touch_vertices) else 0.0
    all_vertices = np.concatenate([vertices, truth.vertices])
    points = np.random.default_rng(0).uniform(all_vertices.min(axis=0), all_vertices.max(axis=0), (POINTS, 3))
    overlap = intersection_over_union((vertices, faces), (truth.vertices, truth.faces), points)
    return seconds, float(mesh.is_watertight and mesh.volume > 0), mesh.body_count, 1e3 * farthest, overlap


if __name__ == "__main__":
    main()
