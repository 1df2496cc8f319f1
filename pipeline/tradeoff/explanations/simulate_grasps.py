"""What `simulate-grasps` left out: attempts that could not be kept, and exact distances where the grid is enough."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.object_distances import possibly_overlapping_spheres
from pipeline.tradeoff.explain import Count
from stages.simulate_grasps.prepare import prepare_hand, prepare_object
from stages.simulate_grasps.settings import GraspSettings


def explain(settings: GraspSettings, models: Mapping[str, Path], units: Sequence[tuple[Unit, Inputs]]) -> Iterator[Count]:
    """Count the attempts at these objects, and what was measured exactly for their kept grasps."""
    prepared_hand = prepare_hand(settings)
    spheres = prepared_hand.spheres
    for _, inputs in units:
        surface, row = inputs["surfaces"], inputs["grasps"]
        made = int(row["attempts"])
        yield Count("attempts", made, max(settings.attempts - made, 0), "no further one could be kept", "enough attempts")
        field = prepare_object(read_mesh(inputs["surfaces"]), surface["points"], surface["normals"], cell=settings.grid_cell).field
        exact = int(field.records[..., 1:].any(axis=-1).sum())
        cells = field.inside.size
        yield Count("grid cells measured", exact, cells - exact, "farther from the object than any part of a hand is asked about")
        for pose, angles in zip(row["hand_pose"], row["joint_angles"], strict=True):
            points = spheres.world_centres(forward_kinematics(prepared_hand.hand, pose, angles)[None])[:, 0]
            measured = len(possibly_overlapping_spheres(field, spheres, points))
            why = "clear of the object by the grid already"
            yield Count("spheres measured exactly", measured, len(spheres.radii) - measured, why, "doubtful spheres")
