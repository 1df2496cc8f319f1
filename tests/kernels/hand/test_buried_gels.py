"""Gels inside their links: how deep, and where they belong."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.convex_shapes import buried_gels, depth_in_link
from pipeline.kernels.hand.model import Hand, Link, Shape

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
