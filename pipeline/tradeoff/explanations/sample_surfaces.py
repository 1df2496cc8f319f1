"""What `sample-surfaces` left out: faces without area, faces that repeat, and the surface that nothing outside can touch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.kernels.geometry.exterior_sampling import MIN_ESCAPES, EscapeTest
from pipeline.kernels.geometry.mesh import face_cross_products, sample_triangles
from pipeline.tradeoff.explain import Count
from stages.sample_surfaces.settings import SurfaceSettings
from stages.sample_surfaces.stage import normalised_mesh


def explain(settings: SurfaceSettings, models: Mapping[str, Path], units: Sequence[tuple[Unit, Inputs]]) -> Iterator[Count]:
    """Clean these objects' meshes again, and count how many points of their whole surfaces are exterior."""
    for unit, _ in units:
        mesh, _, report = normalised_mesh(unit, settings)
        yield Count("faces", len(mesh.faces), report.degenerate_faces, "without area")
        yield Count("faces", len(mesh.faces), report.duplicate_faces, "the same as another one")
        points, face = sample_triangles(mesh.triangles, settings.points, unit.rng("sample-surfaces", "explain"))
        normals = face_cross_products(mesh.triangles)[face]
        front, back = EscapeTest(mesh, settings.directions).count(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))
        exterior = int((front + back >= MIN_ESCAPES).sum())
        yield Count("points of the surface", exterior, len(points) - exterior, "inside: fewer than two directions lead out")
