"""Objects of a size that a network has not learned are given to it larger or smaller, and their reconstructions in their own size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.inference.observation_checks import ModelInputs, faults
from pipeline.inference.observation_file import RobotObservation, load_observation
from pipeline.inference.observation_placement import place_observation
from pipeline.kernels.geometry.transforms import transform_points
from tests.inference.robot import model, scaled_pose, write_files, write_observation


def of_sizes(*diagonals: float) -> ModelInputs:
    return replace(model(), diagonals=diagonals)


@pytest.fixture
def observation(tmp_path: Path) -> RobotObservation:
    return load_observation(write_observation(tmp_path, write_files(tmp_path)))


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
    small, large = (place_observation(item, of_sizes(0.5, 0.5)) for item in (observation, enlarged(observation, factor)))
    assert small.image is not None
    assert small.camera is not None
    np.testing.assert_array_equal(small.image, large.image)
    np.testing.assert_allclose(small.camera, large.camera, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(small.sensor_poses[:, :3, 3], large.sensor_poses[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(small.sensor_poses[:, :3, :3], factor * large.sensor_poses[:, :3, :3], atol=1e-12)  # the gels grow too
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(small.returned(transform_points(small.to_network, points)), points, atol=1e-12)
    assert f"the object is given {factor:.3g} times as large" in "\n".join(small.remarks)


@pytest.mark.parametrize(("sizes", "factor"), [((0.4, 0.8), 0.4), ((0.01, 0.1), 0.1), ((0.1, 0.5), None), ((0.25, 0.5), None), ((), None)])
def test_object_is_scaled_to_the_nearest_size_unless_it_is_close(
    observation: RobotObservation, sizes: tuple[float, ...], factor: float | None
) -> None:
    diagonal = observation.object.diagonal
    assert diagonal is not None
    placed = place_observation(observation, of_sizes(*sizes) if sizes else model())
    scale = np.linalg.norm(placed.to_network[:3, :3], axis=0)
    np.testing.assert_allclose(scale, 1.0 if factor is None else factor / diagonal, rtol=1e-12)


def test_object_larger_than_the_networks_ball_is_a_fault_only_if_it_is_notscaled_pose(observation: RobotObservation) -> None:
    wide = enlarged(observation, 10)
    assert any("knows objects of at most" in line for line in faults(wide, model()))
    assert not faults(wide, of_sizes(0.5, 0.5))
