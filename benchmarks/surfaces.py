"""`python -m benchmarks.surfaces`: 10,000 exterior points beside the same number drawn without looking for the outside."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

import igl
import numpy as np

from pipeline.config.manifest import load_manifest
from pipeline.engine.stage import Task
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from stages.sample_surfaces.stage import source_mesh

POINTS = 10_000
REPEATS = 5


def least_ms(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        action()
        times.append(1e3 * (time.perf_counter() - began))
    return min(times)


def main() -> None:
    rows = []
    for item in load_manifest("toy").objects():
        source = source_mesh(Task(item.object_id, item.category, 0, item.source))
        mesh = normalise_mesh(clean_mesh(source, 1_000_000)[0], item.source.get("up", "z"), 0.5)
        points, _ = sample_exterior(mesh, POINTS, np.random.default_rng(0))
        off = np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces.astype(np.int64))[0]).max()
        rows.append(
            (
                item.object_id,
                len(mesh.faces),
                least_ms(lambda source=source: clean_mesh(source, 1_000_000)),
                least_ms(lambda mesh=mesh: sample_triangles(mesh.triangles, POINTS, np.random.default_rng(0))),
                least_ms(lambda mesh=mesh: sample_exterior(mesh, POINTS, np.random.default_rng(0))),
                1e6 * off,
            )
        )
    print(f"{'object':16}{'faces':>8}{'gate ms':>10}{'any ms':>10}{'exterior ms':>13}{'off surface µm':>16}")
    for name, faces, gated, anywhere, exterior, off in rows:
        print(f"{name:16}{faces:8d}{gated:10.1f}{anywhere:10.1f}{exterior:13.1f}{off:16.1e}")
    exterior_ms = [row[4] for row in rows]
    print(f"\n{POINTS} exterior points: median {median(exterior_ms):.0f} ms, worst {max(exterior_ms):.0f} ms (want 300)")


if __name__ == "__main__":
    main()
