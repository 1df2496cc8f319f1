"""Measure `implicit-any` on objects of other sizes than 0.5 m, as a robot records them: `python -m benchmarks.observed_sizes DATA`.

The first grasp of each object is written as a robot's observation, and reconstructed by `predict` from the photograph alone, with its
depth as touch, and with touches; its size is also guessed from its mask. Errors are Chamfer distances × 9000 of objects scaled to the size
that the network has learned.
"""

import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import yaml

from benchmarks.robot_grasp import BASE, write_grasp
from benchmarks.timing import Table
from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.geometry.mesh import sample_triangles
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, POSITION, bounding_diagonal
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR, cloud_distances
from pipeline.models.shipped_weights import DEFAULT
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.predict import PredictOptions, reconstruct

POINTS = 10_000
"""Points drawn from a reconstruction."""
PLACE, SIZE = "middle of the object by its depth, mm", "diagonal of the object by its depth, error in %"
BY_MASK = "diagonal of the object by its mask, error in %"


def observations(folder: Path) -> dict[str, Path]:
    """List the files of one grasp, in the folder of a robot's observation, by what they give."""
    entries = yaml.safe_load((folder / "grasp.yaml").read_text())
    seen = {name: entries[name] for name in ("unit", "object", "camera")}
    (folder / "seen.yaml").write_text(yaml.safe_dump(seen))
    del seen["object"]["diagonal"], seen["camera"]["depth"]
    (folder / "masked.yaml").write_text(yaml.safe_dump(seen))
    return {
        "photograph": folder / "seen.yaml",
        "photograph and depth as touch": folder / "rgbd.yaml",
        "photograph and touches": folder / "grasp.yaml",
    }


def measure(data: Path) -> Table:
    """Reconstruct each object of a dataset from its first grasp; give the errors by what was given."""
    rows, errors = ObjectRows(data, ["points"], None), defaultdict[str, list[float]](list)
    rng, options = np.random.default_rng(0), PredictOptions(configuration=DEFAULT)
    target = options.reader().target
    with tempfile.TemporaryDirectory() as folder:
        for object_id in rows.object_ids:
            points = rows.read("points", object_id).astype(np.float64)
            scale, truth = DIAGONAL / bounding_diagonal(points), transform_points(BASE, points)
            write_grasp(data, object_id, 0, Path(folder))
            paths = observations(Path(folder))
            box, masked = (check(Path(folder) / f"{name}.yaml", target).box for name in ("rgbd", "masked"))
            middle = transform_points(BASE, np.array([POSITION]))[0]
            errors[PLACE].append(1e3 * scale * float(np.linalg.norm(box.centre - middle)))
            for key, found in ((SIZE, box), (BY_MASK, masked)):
                errors[key].append(100 * abs((found.diagonal or 0) * scale / DIAGONAL - 1))
            for given, path in paths.items():
                mesh = reconstruct(path, options).closed
                assert mesh is not None
                drawn, _ = sample_triangles(mesh.vertices[mesh.faces], POINTS, rng)
                errors[given].append(TABLE_3_FACTOR * scale**2 * cloud_distances(drawn, truth).chamfer)
            print(object_id, *(f"{given} {values[-1]:.3g}" for given, values in errors.items()), sep=", ", flush=True)
    table = Table(f"Chamfer distance × 9000 at {DIAGONAL} m of {len(rows)} objects", ("mean", "median"))
    for given, values in errors.items():
        table.add(given, f"{np.mean(values):.3g}", f"{np.median(values):.3g}")
    return table


if __name__ == "__main__":
    print(measure(Path(sys.argv[1])).markdown(f"{DEFAULT}, one grasp of each object."))
