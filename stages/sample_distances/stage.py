"""`sample-distances`: signed distances from points in space to every object's surface, which implicit networks learn from."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.kernels.geometry.normalise import bounding_diagonal
from pipeline.kernels.geometry.signed_distance import sample_around_surface, signed_distances
from pipeline.kernels.networks.network_configurations import RADIUS
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.distances import DISTANCES
from schemas.surfaces import SURFACES
from stages.sample_distances.settings import DistanceSettings


class SampleDistances(ObjectStage):
    """Draw points around every object, and measure their distance from its surface."""

    name = "sample-distances"
    summary = "Draw points in space and measure their signed distance to the surface: for implicit networks."
    output = DISTANCES
    settings_type = DistanceSettings

    def inputs(self, settings: DistanceSettings) -> tuple[Artifact, ...]:
        """Name the meshes and the points on them."""
        return (SURFACES,)

    def cost(self, settings: DistanceSettings) -> Cost:
        """Estimate a distance and a winding number per point."""
        return Cost(seconds=0.25 * settings.queries / 16_384, kilobytes=240 * settings.queries / 16_384)

    @contextmanager
    def session(self, settings: DistanceSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Keep nothing between objects."""
        yield lambda unit, inputs: _process(unit, inputs, settings)


def _process(unit: Unit, inputs: Inputs, settings: DistanceSettings) -> Row:
    view = inputs["surfaces"]
    mesh = read_mesh(view)
    scale = bounding_diagonal(mesh.vertices) / (2 * RADIUS)
    spread = (scale * settings.least_spread, scale * settings.most_spread)
    surface, rng = view["points"].astype(np.float64), unit.rng("sample-distances")
    points = sample_around_surface(surface, settings.queries, rng, near=settings.near, spread=spread, reach=scale * settings.reach)
    queries = points.astype(np.float32)
    distances = signed_distances(queries.astype(np.float64), mesh.vertices, mesh.faces)
    return {"query_points": queries, "signed_distance": distances.astype(np.float32)}
