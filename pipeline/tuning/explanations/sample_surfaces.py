"""What `sample-surfaces` left out: faces that are none, points that nothing outside can touch, rays whose answer was known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.engine.stage import Task
from pipeline.kernels.geometry.exterior_sampling import draws
from pipeline.kernels.geometry.mesh_cleaning import clean_mesh
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.tuning.explain import Count
from stages.sample_surfaces.settings import SurfaceSettings
from stages.sample_surfaces.stage import source_mesh


def explain(settings: SurfaceSettings, models: Mapping[str, Path], tasks: Sequence[Task]) -> Iterator[Count]:
    """Gate these objects and draw their points again, counting."""
    for task in tasks:
        mesh, report = clean_mesh(source_mesh(task), settings.max_faces)
        yield Count("faces", len(mesh.faces), report.degenerate_faces, "without area")
        yield Count("faces", len(mesh.faces), report.duplicate_faces, "the same as another one")
        mesh = normalise_mesh(mesh, task.source.get("up", "z"), settings.diagonal, task.source.get("metres_per_unit"))
        for draw in draws(mesh, settings.points, task.rng("sample-surfaces"), settings.directions):
            exterior = int(draw.exterior.sum())
            yield Count("points drawn", exterior, len(draw.points) - exterior, "inside: fewer than two directions lead out")
            traced = int(draw.asked.sum())
            full = settings.directions * len(draw.points)
            yield Count("rays traced", traced, full - traced, "the point is exterior and its side sure", "sure of side")
