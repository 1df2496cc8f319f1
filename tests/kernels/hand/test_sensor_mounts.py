"""How sensors lie on the surfaces of their links: depth, distance, direction, and the remedies."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.model import Hand, Link, Shape
from pipeline.kernels.hand.sensor_mounts import depth_in_link, hulls_of, misplaced_sensors, nearest_surface

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
    return replace(GRIPPER, links=(link, *GRIPPER.links[1:]), sensors=(replace(GRIPPER.sensors[0], link=0, pose=pose),))


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
    assert depth_in_link(hulls_of(wearing(link_of(*spans), 0.0), 0), np.zeros(3), UP, ahead=ahead) == pytest.approx(depth)


def test_gel_wholly_inside_its_link_is_moved_to_the_surface() -> None:
    link = link_of((-0.02, 0.02))
    assert list(misplaced_sensors(wearing(link, 0.005), [SENSOR])) == [
        (True, "the gel of left lies inside its link pad, which objects meet first; move its `origin` by 15 mm, to [0, 0, 0.02]")
    ]
    assert list(misplaced_sensors(wearing(link, 0.02), [SENSOR])) == []


def test_gel_partly_inside_its_link_loses_what_lies_inside() -> None:
    ((wholly, sentence),) = misplaced_sensors(wearing(link_of((-0.02, 0.02)), 0.018), [SENSOR])
    assert not wholly
    assert sentence == (
        f"the sensor plane of left lies inside its link pad, so that objects meet only the outer {1e3 * SENSOR.w - 2:.2g} mm of its gel; "
        "move its `origin` by 2 mm, to [0, 0, 0.02]"
    )


def test_normal_that_points_into_the_link_is_turned() -> None:
    ((wholly, sentence),) = misplaced_sensors(wearing(link_of((-0.02, 0.02)), 0.02, -UP), [SENSOR])
    assert wholly
    assert sentence.endswith("its normal points into the link: write `normal: [0, 0, 1]`")


@pytest.mark.parametrize("name", ["allegro_left", "allegro_right", "two_finger_gripper"])
def test_gels_of_shipped_hands_lie_on_their_links(name: str) -> None:
    hand = load_hand(name)
    assert list(misplaced_sensors(hand, [SENSOR] * len(hand.sensors))) == []


def test_surface_of_a_link_without_shapes_is_that_of_what_it_is_fixed_to() -> None:
    hand = load_hand("allegro_right")  # a fingertip's frame that is fixed to the last link
    tip = hand.sensors[0].link
    moved = [replace(link, collisions=()) if number == tip else link for number, link in enumerate(hand.links)]
    surface = nearest_surface(hulls_of(replace(hand, links=tuple(moved)), tip), np.array([0.05, 0.0, -0.01]), np.array([1.0, 0.0, 0.0]))
    assert surface.point == pytest.approx([0.0098, 0, -0.01])  # of link_3.0, whose box is 19.6 mm thick
    assert surface.normal == pytest.approx([1, 0, 0])
    assert surface.distance == pytest.approx(0.0402)


def test_nearest_surface_point_lies_in_no_other_shape() -> None:
    hulls = hulls_of(wearing(link_of((-0.02, 0.0), (-0.001, 0.004)), 0.0), 0)
    surface = nearest_surface(hulls, np.array([0.0, 0.0, 0.0001]), UP)
    assert surface.point == pytest.approx([0, 0, 0.004])
    assert surface.normal == pytest.approx(UP)
