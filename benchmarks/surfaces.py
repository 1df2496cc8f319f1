"""`python -m benchmarks.surfaces`: 10,000 exterior points beside the same number drawn without looking for the outside."""

from __future__ import annotations

from statistics import median

import igl
import numpy as np

from benchmarks.timing import alone, side_by_side
from pipeline.config.manifest import load_manifest
from pipeline.engine.unit import Unit
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from stages.sample_surfaces.settings import SurfaceSettings
from stages.sample_surfaces.stage import source_mesh

POINTS = 10_000
TURNS = 5


def main() -> None:
    """Print the table."""
    settings, exterior_ms = SurfaceSettings(), []
    print(f"{'object':16}{'faces':>8}{'clean ms':>10}{'any ms':>10}{'exterior ms':>13}{'off surface µm':>16}")
    for item in load_manifest("toy").objects():
        source = source_mesh(Unit(item.object_id, source=item.source))
        mesh = normalise_mesh(clean_mesh(source, settings.max_faces)[0], up=item.source.get("up", "z"), diagonal=settings.diagonal)
        points, _ = sample_exterior(mesh, POINTS, np.random.default_rng(0))
        off = np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces.astype(np.int64))[0]).max()
        ways = {
            "clean": alone(lambda source=source: clean_mesh(source, settings.max_faces)),
            "any": alone(lambda mesh=mesh: sample_triangles(mesh.triangles, POINTS, np.random.default_rng(0))),
            "exterior": alone(lambda mesh=mesh: sample_exterior(mesh, POINTS, np.random.default_rng(0))),
        }
        clean, anywhere, exterior = (times.least for times in side_by_side(ways, TURNS).values())
        exterior_ms.append(exterior)
        print(f"{item.object_id:16}{len(mesh.faces):8d}{clean:10.1f}{anywhere:10.1f}{exterior:13.1f}{1e6 * off:16.1e}")
    print(f"\n{POINTS} exterior points: median {median(exterior_ms):.0f} ms, worst {max(exterior_ms):.0f} ms (want 300)")


if __name__ == "__main__":
    main()
