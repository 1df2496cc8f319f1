"""`sample-distances`: signed distances from points in space to every object's surface, which implicit networks learn from."""

import numpy as np

from pipeline.config.settings import ObjectSettings, setting
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Unit
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, bounding_diagonal
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.distances import DISTANCES
from schemas.surfaces import SURFACES

NEAR = 0.75  # share of the points that are near the surface, where a network's answer decides on its shape
SPREAD = (1e-3, 0.05)
"""m, for objects of 0.5 m: least and greatest standard deviation of the points near the surface. Half the thinnest blade is the least;
each point's is uniform in its logarithm between both."""
REACH = 0.27  # m, likewise: half the side of the cube that the other points fill; objects reach 0.25 m from its middle


class DistanceSettings(ObjectSettings):
    """The points at which distances to the surface are recorded."""

    queries: int = setting(16_384, "points per object; a training draws some hundreds of them at a time", gt=0)


class SampleDistances(ObjectStage):
    """Draw points around every object, and measure their distance from its surface."""

    name = "sample-distances"
    summary = "Draw points in space and measure their signed distance to the surface: for implicit networks."
    output = DISTANCES
    settings_type = DistanceSettings

    def inputs(self, settings: DistanceSettings) -> tuple[Artifact, ...]:
        return (SURFACES,)

    def cost(self, settings: DistanceSettings) -> Cost:
        """Estimate a distance and a winding number per point."""
        return Cost(seconds=0.25 * settings.queries / 16_384, kilobytes=240 * settings.queries / 16_384)

    def process(self, unit: Unit, inputs: Inputs, settings: DistanceSettings) -> Row:
        from pipeline.kernels.geometry.signed_distance import sample_around_surface, signed_distances

        surface = inputs["surfaces"]
        mesh = read_mesh(surface)
        scale = bounding_diagonal(mesh.vertices) / DIAGONAL
        spread = (scale * SPREAD[0], scale * SPREAD[1])
        points, rng = surface["points"].astype(np.float64), unit.rng("sample-distances")
        queries = sample_around_surface(points, settings.queries, rng, near=NEAR, spread=spread, reach=scale * REACH).astype(np.float32)
        distances = signed_distances(queries.astype(np.float64), mesh.vertices, mesh.faces)
        return {"query_points": queries, "signed_distance": distances.astype(np.float32)}
