"""Warnings of objects that fit neither the hand nor the image."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.hand.kinematics import opening
from pipeline.kernels.vision.camera import Camera, DrawnViews
from stages.render_vision.stage import is_speck, leaves_image, surrounds_lens
from stages.simulate_grasps.stage import GraspSettings, SimulateGrasps

ABOVE = Camera(name="camera", position=(0, 0, 1), rotation=(0, 0, 0), focal=(100, 100), centre=(32, 32), resolution=64)


def test_gripper_opens_as_far_as_its_fingers_slide() -> None:
    assert opening(load_hand("two_finger_gripper")) == pytest.approx(0.14)


@pytest.mark.parametrize("sensors", [0, 1])
def test_gripper_without_opposed_sensors_opens_as_far_as_its_last_links(sensors: int) -> None:
    """The middle of a finger is 6 mm behind its sensor."""
    hand = load_hand("two_finger_gripper")
    palm = replace(hand.sensors[0], link=0, pose=np.eye(4))
    bare = replace(hand, sensors=(*hand.sensors[:sensors], palm))
    assert opening(bare) == pytest.approx(0.152)


@pytest.mark.parametrize(("point", "leaves"), [((0.31, 0, 0), False), ((0.33, 0, 0), True), ((0, -0.33, 0), True), ((0, 0, 2), True)])
def test_object_leaves_the_image_if_one_of_its_points_does(point: tuple[float, float, float], leaves: bool) -> None:
    assert leaves_image(ABOVE, np.array([(0, 0, 0), point])) == leaves


@pytest.mark.parametrize(("side", "speck"), [(0.02, True), (0.08, False)])
def test_object_of_few_pixels_is_reported_as_too_small(side: float, speck: bool) -> None:
    """At 1 m and a focal length of 100 pixels, 64 mm are a tenth of 64 pixels."""
    assert is_speck(ABOVE, side * np.array([(-0.5, 0, 0), (0.5, 0, 0)])) == speck


@pytest.mark.parametrize(("nearest", "inside"), [(0.2, True), (0.3, False), (None, False)])
def test_object_around_the_least_distance_of_a_drawn_camera_is_reported(nearest: float | None, inside: bool) -> None:
    drawn = None if nearest is None else DrawnViews(distance=(nearest, 0.8), elevation=(0, 10))
    camera = ABOVE.model_copy(update={"drawn": drawn})
    assert surrounds_lens(camera, np.array([(-0.25, 0, 0), (0.25, 0, 0)])) == inside


def test_size_warnings_name_the_objects() -> None:
    sides = {"speck": (0.002, 0.003, 0.004), "mug": (0.1, 0.1, 0.12), "crate": (0.9, 0.7, 1.2), "pole": (2.0, 0.02, 0.02)}
    objects = [(name, {"surfaces": {"points": np.array([np.zeros(3), size])}}) for name, size in sides.items()]
    lines = list(SimulateGrasps().describe_misfits(GraspSettings(hand="two_finger_gripper"), objects))
    small, large = (line for line in lines if "is the unit right" in line)
    assert "1 object smaller" in small
    assert "speck" in small
    assert "1 object wider" in large
    assert "crate" in large
