"""Convex shapes of large meshes: face budget, error bound measured independently; and gels inside their links."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.convex_shapes import MAX_FACES, TOLERANCE, buried_gels, convex_error, depth_in_link, with_convex_shapes
from pipeline.kernels.hand.model import Hand, Link, Shape


def link(*meshes: Any) -> Link:
    shapes = [Shape("mesh", (1.0, 1.0, 1.0), np.eye(4), Mesh.bare(mesh.vertices, mesh.faces)) for mesh in meshes]
    return Link("link", (), tuple(shapes))


def bumpy_link(rng: np.random.Generator) -> Any:
    """Make a bumpy link of a finger's size."""
    body = trimesh.creation.icosphere(subdivisions=5)
    body.vertices = body.vertices * [0.012, 0.015, 0.05] * (1 + 2e-4 * rng.standard_normal((len(body.vertices), 1)))
    return body


def distance_outside(points: np.ndarray, mesh: Mesh) -> float:
    """Compute the greatest distance of points from a convex body, by trimesh."""
    body = trimesh.Trimesh(mesh.vertices, mesh.faces).convex_hull
    hull = ConvexHull(mesh.vertices)
    height = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    beyond = points[np.argsort(height)[-500:]]  # a distance is no less than the height above a plane
    beyond = beyond[np.sort(height)[-500:] > 0]
    return float(trimesh.proximity.closest_point_naive(body, beyond)[1].max()) if len(beyond) else 0.0


def test_large_mesh_becomes_a_hull_within_the_budget_and_the_reported_loss(rng: np.random.Generator) -> None:
    body = bumpy_link(rng)
    heavy = link(body)
    (shape,) = with_convex_shapes(heavy).collisions
    assert len(body.faces) == 20_480
    assert len(ConvexHull(body.vertices).simplices) > 2 * MAX_FACES
    assert len(shape.mesh.faces) <= MAX_FACES
    corners = body.vertices[ConvexHull(body.vertices).vertices]
    lost = distance_outside(corners, shape.mesh)
    error = convex_error(heavy, with_convex_shapes(heavy))
    assert (error.faces, error.kept) == (len(body.faces), len(shape.mesh.faces))
    assert error.lost == pytest.approx(lost, abs=1e-9)
    assert 0 < lost <= 4 * TOLERANCE
    assert {tuple(vertex) for vertex in shape.mesh.vertices} <= {tuple(vertex) for vertex in body.vertices}  # so nothing is added


def test_slabs_contain_the_surface_between_their_ends() -> None:
    """An open tube: each slab is a drum, and together they are the tube's hull."""
    tube = trimesh.creation.annulus(r_min=0.01, r_max=0.012, height=0.08)
    slabs = with_convex_shapes(link(tube), 4).collisions
    ends = np.linspace(-0.04, 0.04, 5)
    for (low, high), slab in zip(pairwise(ends), slabs, strict=True):
        assert slab.mesh.vertices[:, 2].min() == pytest.approx(low)
        assert slab.mesh.vertices[:, 2].max() == pytest.approx(high)
        assert trimesh.Trimesh(slab.mesh.vertices, slab.mesh.faces).convex_hull.volume == pytest.approx(tube.convex_hull.volume / 4)


def test_depth_of_filled_hollows_is_measured() -> None:
    """A tray with walls of 20 mm: its hull fills it to the brim; slabs across it do so too, except that bare ends of a bar are none."""
    sides = [((0.1, 0.06, 0.002), (0, 0, 0.001)), ((0.1, 0.002, 0.02), (0, 0.029, 0.01)), ((0.1, 0.002, 0.02), (0, -0.029, 0.01))]
    tray = trimesh.util.concatenate([trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in sides])
    error = convex_error(link(tray), with_convex_shapes(link(tray), 1))
    assert error.lost == pytest.approx(0, abs=1e-12)
    assert error.filled == pytest.approx(0.018, abs=0.001)
    bar = link(trimesh.creation.box((0.1, 0.01, 0.01)))
    assert convex_error(bar, with_convex_shapes(bar, 5)).filled == pytest.approx(0, abs=1e-9)  # where slabs meet, nothing is filled


GRIPPER, SENSOR = load_hand("two_finger_gripper"), load_sensor("gel_16mm")
UP = np.array([0.0, 0.0, 1.0])


def link_of(*spans: tuple[float, float]) -> Link:
    """Make a link of boxes, 0.2 m wide, that reach from one height to another, m."""
    shapes = []
    for low, high in spans:
        box = trimesh.creation.box((0.2, 0.2, high - low), trimesh.transformations.translation_matrix((0, 0, (low + high) / 2)))
        shapes.append(Shape("box", (0.2, 0.2, high - low), np.eye(4), Mesh.bare(box.vertices, box.faces)))
    return Link("pad", (), tuple(shapes))


def wearing(link: Link, height: float, normal: NDArray[np.float64] = UP) -> Hand:
    """Make a hand whose only sensor is on a link, at a height, m."""
    x = np.cross([0.0, 1.0, 0.0], normal)
    pose = np.eye(4)
    pose[:3, :3], pose[2, 3] = np.column_stack([x, np.cross(normal, x), normal]), height
    return replace(GRIPPER, links=(link,), sensors=(replace(GRIPPER.sensors[0], link=0, pose=pose),))


@pytest.mark.parametrize(
    ("spans", "ahead", "depth"),
    [
        ([(-0.02, -0.01)], 0.0, 0.0),  # behind the point
        ([(-0.02, 0.0)], 0.0, 0.0),  # the point is on its surface
        ([(-0.02, 0.004), (0.004, 0.01), (0.002, 0.006)], 0.0, 0.01),  # one box on the other
        ([(-0.02, 0.004), (0.02, 0.03)], 0.0, 0.004),  # with a gap
        ([(-0.02, 0.0), (0.003, 0.005)], 0.0, 0.0),
        ([(-0.02, 0.0), (0.003, 0.005)], 0.007, 0.005),  # a plate in the gel
        ([], 0.007, 0.0),
    ],
)
def test_depth_in_a_link_of_several_shapes(spans: list[tuple[float, float]], ahead: float, depth: float) -> None:
    assert depth_in_link(link_of(*spans), np.zeros(3), UP, ahead=ahead) == pytest.approx(depth)


def test_gel_wholly_inside_its_link_is_moved_to_the_surface() -> None:
    link = link_of((-0.02, 0.02))
    assert list(buried_gels(wearing(link, 0.005), [SENSOR])) == [
        (True, "the gel of left lies inside its link pad, which objects meet first; move its `origin` by 15 mm, to [0, 0, 0.02]")
    ]
    assert list(buried_gels(wearing(link, 0.02), [SENSOR])) == []


def test_gel_partly_inside_its_link_loses_what_lies_inside() -> None:
    ((wholly, sentence),) = buried_gels(wearing(link_of((-0.02, 0.02)), 0.018), [SENSOR])
    assert not wholly
    assert sentence == (
        f"the sensor plane of left lies inside its link pad, so that objects meet only the outer {1e3 * SENSOR.w - 2:.2g} mm of its gel; "
        "move its `origin` by 2 mm, to [0, 0, 0.02]"
    )


def test_normal_that_points_into_the_link_is_turned() -> None:
    ((wholly, sentence),) = buried_gels(wearing(link_of((-0.02, 0.02)), 0.02, -UP), [SENSOR])
    assert wholly
    assert sentence.endswith("its normal points into the link: write `normal: [0, 0, 1]`")


@pytest.mark.parametrize("name", ["allegro_left", "allegro_right", "two_finger_gripper"])
def test_gels_of_shipped_hands_lie_on_their_links(name: str) -> None:
    hand = load_hand(name)
    assert list(buried_gels(hand, [SENSOR] * len(hand.sensors))) == []
