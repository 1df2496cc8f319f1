"""Prepared hands and objects: the distance grid classifies clear fingers and palms correctly."""

import shutil

import numpy as np
import pytest

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand.distance_field import finger_clearance
from pipeline.kernels.hand.grid_loops import gaps
from pipeline.kernels.hand.pregrasp import tangent_palm_pose
from stages.simulate_grasps import prepare
from stages.simulate_grasps.prepare import PreparedHand, prepare_hand, prepare_object
from stages.simulate_grasps.stage import GraspSettings
from tests.kernels.hand.meshes import bar, mug, points_on
from tests.references.world_centres import world_centres
from tests.stages.simulate_grasps.conftest import SETTINGS


@pytest.mark.parametrize("hand_name", ["allegro_right", "two_finger_gripper"])
def test_distance_grid_classifies_clear_fingers_as_clear(hand_name: str) -> None:
    """Against exact distances: a band narrower than the fingers' spheres called 38 % of Allegro's clear fingers in the way."""
    prepared = prepare_hand(SETTINGS.model_copy(update={"hand": hand_name}))
    clear = mistaken = missed = 0
    for seed, mesh in enumerate((mug(), bar())):
        rng = np.random.default_rng(seed)
        points, normals = points_on(mesh, 2000, seed=seed)
        prepared_object = prepare_object(mesh, points, normals, reach=prepared.reach)
        for place, distance in zip(rng.integers(len(points), size=8), np.linspace(0.01, 0.15, 8), strict=True):
            pose = tangent_palm_pose(prepared.hand, points[place], normals[place], distance=distance, angle=rng.uniform(0, 2 * np.pi))
            frames = compose(pose, prepared.ik.postures.frames[rng.integers(len(prepared.ik.postures.frames), size=20)])
            by_grid = finger_clearance(prepared_object.field, prepared.ik.fingers, frames) >= prepared.ik.clearance
            exact = _exact_clearance(prepared, prepared_object.field.exact, frames) >= prepared.ik.clearance
            clear, mistaken, missed = clear + exact.sum(), mistaken + (exact & ~by_grid).sum(), missed + (~exact & by_grid).sum()
    assert clear > 150
    assert mistaken <= 0.03 * clear
    assert missed <= 0.03 * clear


@pytest.mark.parametrize("hand_name", ["allegro_right", "two_finger_gripper"])
def test_palm_far_from_the_object_is_clear_by_the_grid(hand_name: str) -> None:
    """A band narrower than the palm's spheres had a gripper's palm in the way at any distance."""
    prepared, mesh = prepare_hand(SETTINGS.model_copy(update={"hand": hand_name})), bar()
    points, normals = points_on(mesh, 2000, seed=0)
    field = prepare_object(mesh, points, normals, reach=prepared.reach).field
    rng, clearance = np.random.default_rng(0), prepared.ik.clearance
    poses = [
        tangent_palm_pose(prepared.hand, points[place], normals[place], distance=0.15, angle=rng.uniform(0, 2 * np.pi))
        for place in rng.integers(len(points), size=200)
    ]
    frames = compose(np.array(poses)[:, None], prepared.ik.postures.frames[0])
    centres = world_centres(prepared.palm_spheres, frames)
    exact = (field.exact(centres.reshape(-1, 3)).reshape(centres.shape[:2]) - prepared.palm_spheres.radii).min(axis=1)
    by_grid = gaps(field.grid, frames, prepared.palm_spheres.single, np.float32(clearance))
    assert (exact >= clearance).sum() > 150
    np.testing.assert_array_equal(by_grid >= clearance, exact >= clearance)


def _exact_clearance(prepared: PreparedHand, exact, frames: np.ndarray) -> np.ndarray:
    """(N, F) m, of every sphere's centre less its radius."""
    gaps = []
    for own in prepared.ik.fingers:
        centres = world_centres(own, frames)
        gaps.append((exact(centres.reshape(-1, 3)).reshape(centres.shape[:2]) - own.radii).min(axis=1))
    return np.stack(gaps, axis=1)


def test_prepared_hand_is_kept_between_runs_by_hand_and_samples(tmp_path, monkeypatch) -> None:
    """Until something appears beside the files of the hand."""
    made = []
    monkeypatch.setattr(prepare, "KEPT", tmp_path / "prepared.pickle")
    monkeypatch.setattr(prepare, "_prepare", lambda hand, sensors, samples: made.append(samples) or (hand.name, samples))
    (tmp_path / "hand").mkdir()
    for file in load_hand("two_finger_gripper").files:
        shutil.copy(file, tmp_path / "hand")
    for samples, times in ((64, 1), (64, 1), (128, 2), (64, 2), (64, 3)):
        if times == 3:
            (tmp_path / "hand" / "finger.mtl").touch()
        settings = GraspSettings(hand=str(tmp_path / "hand" / "two_finger_gripper.yaml"), ik_samples=samples)
        assert prepare.prepare_hand(settings) == ("two_finger_gripper", samples)
        assert len(made) == times
