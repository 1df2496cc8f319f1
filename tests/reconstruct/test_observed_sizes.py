"""Objects are given to networks at one size, and their reconstructions returned in their own."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import place_observation
from tests.reconstruct.robot import scaled_pose, target, write_files, write_observation


@pytest.fixture
def observation(tmp_path: Path) -> RobotObservation:
    return check(write_observation(tmp_path, write_files(tmp_path))).observation


def enlarged(observation: RobotObservation, factor: float) -> RobotObservation:
    """Make the observation of an object and a camera that are larger by a factor; the sensors stay as they are."""
    assert observation.camera is not None
    assert observation.object.centre is not None
    assert observation.object.diagonal is not None
    return observation.changed(
        object={"centre": tuple(factor * np.array(observation.object.centre)), "diagonal": factor * observation.object.diagonal},
        camera=observation.camera.changed(pose=scaled_pose(observation.camera.pose, factor), depth=None),
        touches=tuple(touch.changed(pose=scaled_pose(touch.pose, factor)) for touch in observation.touches),
    )


def test_small_object_is_given_as_one_that_the_network_knows(observation: RobotObservation) -> None:
    diagonal = observation.object.diagonal
    assert diagonal is not None
    factor = 0.5 / diagonal
    small, large = (place_observation(check(item, target(diagonals=(0.5, 0.5)))) for item in (observation, enlarged(observation, factor)))
    assert small.image is not None
    assert small.camera is not None
    np.testing.assert_array_equal(small.image, large.image)
    np.testing.assert_allclose(small.camera, large.camera, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(small.sensor_poses[:, :3, 3], large.sensor_poses[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(small.sensor_poses[:, :3, :3], factor * large.sensor_poses[:, :3, :3], atol=1e-12)  # the gels grow too
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(small.returned(transform_points(small.to_network, points)), points, atol=1e-12)
    assert "the network has learned from objects of 0.5 m: hand and touches have" in "\n".join(small.remarks)
    assert "has learned from" not in "\n".join(large.remarks)


@pytest.mark.parametrize("sizes", [(0.4, 0.8), (0.01, 0.1), None])
def test_object_is_scaled_to_the_size_at_which_networks_see_all(observation: RobotObservation, sizes: tuple[float, float] | None) -> None:
    diagonal = observation.object.diagonal
    assert diagonal is not None
    placed = place_observation(check(observation, target(diagonals=sizes)))
    np.testing.assert_allclose(np.linalg.norm(placed.to_network[:3, :3], axis=0), 0.5 / diagonal, rtol=1e-12)
    check(enlarged(observation, 10), target())


@pytest.mark.parametrize(("sizes", "factor"), [((0.1, 0.4), 2.5), ((0.5, 0.5), 1.0), (None, 1.0)])
def test_unknown_size_is_taken_to_be_that_of_the_training(
    observation: RobotObservation, sizes: tuple[float, float] | None, factor: float
) -> None:
    assert observation.camera is not None
    unknown = observation.changed(object={"centre": observation.object.centre}, camera=observation.camera.changed(mask=None))
    placed = place_observation(check(unknown, target(diagonals=sizes)))
    np.testing.assert_allclose(np.linalg.norm(placed.to_network[:3, :3], axis=0), factor, rtol=1e-12)
    assert f"the object's size is not known, and taken to be {0.5 / factor:g} m, as in training" in placed.remarks


def test_unknown_size_is_that_of_the_mask_at_the_distance_of_the_object(observation: RobotObservation) -> None:
    stated = observation.object.diagonal
    assert stated is not None
    for factor in (1, 3):
        larger = enlarged(observation, factor)
        checked = check(larger.changed(object={"centre": larger.object.centre}), target(diagonals=(0.5, 0.5)))
        assert checked.box.by_mask
        assert checked.box.diagonal == pytest.approx(factor * stated, rel=0.1)
        size = f"{checked.box.diagonal:.2g} m"
        expected = f"the object's diagonal is taken to be {size}, by its mask; it may be twice that in a hand, and what follows goes by it"
        assert f"{expected}: state object.diagonal" in place_observation(checked).remarks


def test_a_mask_of_hardly_a_pixel_or_of_the_border_gives_no_size(observation: RobotObservation) -> None:
    assert observation.camera is not None
    assert observation.camera.mask is not None
    unknown = {"centre": observation.object.centre}
    speck = np.zeros_like(observation.camera.mask)
    speck[60, 80] = True
    for mask in (speck, ~observation.camera.mask):
        masked = observation.changed(object=unknown, camera=observation.camera.changed(mask=mask, depth=None))
        assert check(masked, target()).box.diagonal is None


def test_a_touch_beyond_a_guessed_size_names_the_mask(observation: RobotObservation) -> None:
    assert observation.camera is not None
    assert observation.camera.mask is not None
    rows, cols = np.nonzero(observation.camera.mask)
    middle = np.zeros_like(observation.camera.mask)
    middle[round(rows.mean()) - 2 : round(rows.mean()) + 2, round(cols.mean()) - 2 : round(cols.mean()) + 2] = True
    hidden = observation.changed(object={"centre": observation.object.centre}, camera=observation.camera.changed(mask=middle, depth=None))
    with pytest.raises(InvalidInput, match=r"by its mask the object's diagonal seems to be .* camera.mask and object.diagonal"):
        check(hidden, target())
