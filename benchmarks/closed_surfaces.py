"""`python -m benchmarks.closed_surfaces DATA CONFIGURATION`: closed meshes of test objects, as `predict` writes them, and their cost."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import igl
import numpy as np
import trimesh

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.inference.predict import predict
from pipeline.kernels.metrics.surface_quality import dihedral_angles, intersection_over_union
from pipeline.models.closed_reconstruction import closed
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import place
from schemas.surfaces import SURFACES

POINTS = 20_000
"""In the box around an object and its reconstruction, for their intersection over union."""
COLUMNS = "object", "CPU s", "vertices", "watertight", "parts", "felt within, mm", "dihedral, °", "seen", "IoU"


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("data", type=place)
    arguments.add_argument("configuration")
    arguments.add_argument("--resolution", type=int, nargs="+", default=[128])
    arguments.add_argument("--most", type=int, default=10_000, help="Objects at most, spread evenly.")
    arguments.add_argument("--keep", type=Path, help="Folder for the meshes.")
    asked = arguments.parse_args()
    names = ObjectRows(asked.data, ["points"], "test").object_ids
    names = [names[place] for place in np.linspace(0, len(names) - 1, min(asked.most, len(names))).astype(int)]
    surfaces = DataDirectory(asked.data).collection(SURFACES)
    with tempfile.TemporaryDirectory() as scratch:
        for resolution in asked.resolution:
            print(f"\n{resolution} edges along the longest side")
            print("  ".join(COLUMNS))
            folder = asked.keep or Path(scratch)
            folder.mkdir(exist_ok=True)
            rows = []
            for name in names:
                truth = read_mesh(surfaces.view(name))
                rows.append(one(asked.data, asked.configuration, name, resolution, folder / f"{name}.glb", (truth.vertices, truth.faces)))
                print(name, *(f"{value:.3g}" for value in rows[-1]), sep="  ", flush=True)
            for label, summary in (("mean", np.mean), ("median", np.median), ("worst", np.max), ("least", np.min)):
                print(label, *(f"{value:.3g}" for value in summary(rows, axis=0)), sep="  ")


def one(data, configuration: str, name: str, resolution: int, path: Path, truth) -> tuple[float, ...]:
    made = predict(path, data / "models", configuration, data=data, object_id=name, surface="closed", resolution=resolution)
    began = time.process_time()
    closed(made.reconstruction, resolution)
    seconds = time.process_time() - began
    mesh = trimesh.load_scene(path).to_mesh()  # equal vertices become one, as other programs make them
    vertices, faces = mesh.vertices[:, [0, 2, 1]] * [1, -1, 1], np.asarray(mesh.faces)  # glTF is y up
    vertices = np.ascontiguousarray(vertices)
    felt = np.asarray(made.reconstruction.vertices[made.reconstruction.vision :])
    apart = np.sqrt(igl.point_mesh_squared_distance(felt, vertices, faces)[0]).max() if len(felt) else 0.0
    low, high = (pick(np.concatenate([vertices, truth[0]]), axis=0) for pick in (np.min, np.max))
    points = np.random.default_rng(0).uniform(low, high, (POINTS, 3))
    return (
        seconds,
        len(vertices),
        float(mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0),
        mesh.body_count,
        1e3 * apart,
        float(np.median(dihedral_angles(vertices, faces))),
        float(made.closed.seen.mean()) if made.closed else 0.0,
        intersection_over_union((vertices, faces), truth, points),
    )


if __name__ == "__main__":
    main()
