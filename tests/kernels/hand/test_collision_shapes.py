"""Spheres and boxes in place of the hand's rigid links."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.distance_field import build_distance_field
from pipeline.kernels.hand.model import Hand
from tests.references.box_distance import box_distance
from tests.references.world_centres import world_centres

HAND = load_hand("allegro_right")


def with_collision(vertices: np.ndarray) -> Hand:
    """Make a hand with one link, whose collision shape has the given corners."""
    link = next(link for link in HAND.links if link.collisions)
    shape = replace(link.collisions[0], kind="mesh", origin=np.eye(4), mesh=Mesh.bare(vertices, np.array([[0, 1, 2], [1, 2, 3]])))
    return replace(HAND, links=(replace(link, collisions=(shape,)),))


def test_spheres_stay_in_their_boxes_and_reach_the_corners(hand: Hand) -> None:
    spheres = collision_spheres(hand, spacing=0.004)
    for number, link in enumerate(hand.links):
        own = spheres.of_links([number])
        depth = -np.min([box_distance(own.centres - shape.origin[:3, 3], shape.size) for shape in link.collisions], axis=0)
        assert (own.radii <= depth + 1e-9).all()
        assert (depth >= -1e-9).all()
        for shape in link.collisions:
            corners = trimesh.creation.box(shape.size).vertices + shape.origin[:3, 3]
            gaps = np.linalg.norm(corners[:, None] - own.centres, axis=-1) - own.radii
            assert gaps.min(axis=1).max() < 1e-6


def test_pruned_spheres_reach_as_far_within_the_tolerance(hand: Hand) -> None:
    tolerance = 0.002
    all_, few = collision_spheres(hand, spacing=0.006), collision_spheres(hand, spacing=0.006, tolerance=tolerance)
    assert len(few.radii) < len(all_.radii) / 3
    for number in range(len(hand.links)):
        own, kept = all_.of_links([number]), few.of_links([number])
        gap = np.linalg.norm(own.centres[:, None] - kept.centres, axis=-1) + own.radii[:, None] - kept.radii
        assert gap.min(axis=1).max() <= tolerance + 1e-12


def test_spheres_detect_a_needle_inside_a_link(hand: Hand) -> None:
    """No surface point of the hand lies in the needle, which reaches 8 mm into the hand."""
    needle = trimesh.creation.box((0.0002, 0.0002, 0.1)).apply_translation([0, 0, 0.05])
    field = build_distance_field(needle.vertices, needle.faces, cell=0.0025, band=0.012)
    spheres = collision_spheres(hand, spacing=0.003).of_links([hand.fingers[1].links[1]])
    box = next(shape for shape in hand.links[hand.fingers[1].links[1]].collisions)
    frames = np.tile(np.eye(4), (len(hand.links), 1, 1))
    frames[:, :3, 3] = [0, 0, -box.size[2] + 0.008]  # the link's far face is 8 mm above the needle's point
    depth = -(field.exact(world_centres(spheres, frames)) - spheres.radii).min()
    assert depth == pytest.approx(0.008, abs=0.0015)


def test_flat_collision_shape_is_rejected_with_its_link() -> None:
    flat = with_collision(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    with pytest.raises(InvalidInput, match=r"allegro_right\.urdf: collision shape mesh .* of link \S+ is flat or not finite"):
        collision_spheres(flat, spacing=0.1)
