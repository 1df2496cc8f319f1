"""The library `vt_pipeline`: touches against closed forms, many at once, grasps, and packages that hide ours."""

import multiprocessing
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import vt_pipeline as vt
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image
from tests.kernels.touch.shapes import pose_at
from tests.strategies import random_rotation

RADIUS, PRESSED = 0.02, 0.0012
SENSOR = vt.load_sensor("gel_16mm")
MESH = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
BALL = vt.load_object((MESH.vertices, MESH.faces))


def poses(count: int) -> np.ndarray:
    axes = np.random.default_rng(0).normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.stack([pose_at(RADIUS * axis, -axis, SENSOR.w - PRESSED) for axis in axes])


def test_touch_of_a_ball_matches_the_kernels_and_the_sphere() -> None:
    (pose,) = poses(1)
    touch = vt.touch(BALL, SENSOR, pose)
    exact = ray_depth(BALL.faces, pose, SENSOR)
    assert (touch.depth == exact.astype(np.float32)).all()
    assert (touch.image == tactile_image(touch.depth, SENSOR)).all()
    assert touch.success
    assert touch.contact_area == pytest.approx(np.pi * (2 * RADIUS * PRESSED - PRESSED**2), rel=0.02)
    assert touch.points.shape == touch.normals.shape == (touch.contact.sum(), 3)
    radii = np.linalg.norm(touch.points, axis=1)
    assert np.abs(radii - RADIUS).max() < 5e-5  # distance of the mesh from the sphere
    cosine = (touch.points / radii[:, None] * touch.normals).sum(axis=1)
    assert np.median(cosine) > 0.999
    assert cosine.min() > 0.95
    assert (touch.difference[~touch.contact] == 0).mean() > 0.95
    assert np.abs(touch.difference).max() > 20


def test_touch_depends_only_on_the_relative_pose_of_object_and_sensor(rng: np.random.Generator) -> None:
    """Moving both alike changes only the positions of the points."""
    (pose,) = poses(1)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = random_rotation(rng), rng.uniform(-1, 1, 3)
    here, there = vt.touch(BALL, SENSOR, pose), vt.touch(BALL, SENSOR, motion @ pose, object_pose=motion)
    np.testing.assert_allclose(there.depth[here.contact], here.depth[here.contact], atol=1e-7)
    np.testing.assert_allclose(there.points, here.points @ motion[:3, :3].T + motion[:3, 3], atol=1e-6)
    away = np.eye(4)
    away[2, 3] = 1.0
    assert not vt.touch(BALL, SENSOR, pose, object_pose=away).success


def test_touches_keep_their_pose_when_the_caller_moves_on() -> None:
    sensor_poses = poses(2)
    one, many = vt.touch(BALL, SENSOR, sensor_poses[0]), vt.touch_many(BALL, SENSOR, sensor_poses)
    sensor_poses[:, :3, 3] += 1
    for touch in (one, many[0], many[1]):
        assert np.linalg.norm(touch.points, axis=1).max() < 2 * RADIUS


def test_touch_many_equals_single_touches_for_any_number_of_processes() -> None:
    sensor_poses = poses(7)
    alone, shared = vt.touch_many(BALL, SENSOR, sensor_poses, workers=1), vt.touch_many(BALL, SENSOR, sensor_poses, workers=3)
    assert len(shared) == 7
    for number, pose in enumerate(sensor_poses):
        single = vt.touch(BALL, SENSOR, pose)
        for many in (alone, shared):
            assert (many[number].depth == single.depth).all()
            assert (many.image[number] == single.image).all()
    assert len(vt.touch_many(BALL, SENSOR, np.zeros((0, 4, 4)))) == 0


def _many_touches(_: int) -> np.ndarray:
    return vt.touch_many(BALL, SENSOR, poses(3), workers=2).depth


def test_touch_many_works_in_a_process_that_may_start_none() -> None:
    with multiprocessing.get_context("fork").Pool(1) as pool:  # as a DataLoader's
        (depth,) = pool.map(_many_touches, [0])
    np.testing.assert_array_equal(depth, vt.touch_many(BALL, SENSOR, poses(3)).depth)


def test_invalid_mesh_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "mug.glb").write_text("no mesh")
    with pytest.raises(vt.InvalidInput, match=r"mug\.glb"):
        vt.load_object(tmp_path / "mug.glb")


def test_files_sensor_names_and_a_single_pose_are_accepted(tmp_path: Path) -> None:
    MESH.export(tmp_path / "ball.stl")
    pose = np.eye(4)
    pose[2, 3] = -RADIUS - 0.004
    by_name = vt.touch(tmp_path / "ball.stl", "gel_16mm", pose)
    loaded = vt.load_object(str(tmp_path / "ball.stl"))
    assert (by_name.depth == vt.touch(loaded, vt.load_sensor("gel_16mm"), pose).depth).all()
    many = vt.touch_many(loaded, "gel_16mm", pose)
    assert len(many) == 1
    assert (many[0].depth == by_name.depth).all()
    for value in (loaded, by_name, many):
        assert len(repr(value)) < 100


def test_sensor_is_accepted_by_name_and_printed_in_one_line() -> None:
    np.testing.assert_array_equal(vt.untouched_image("gel_16mm"), vt.untouched_image(vt.load_sensor("gel_16mm")))
    assert str(vt.load_sensor("gelsight_mini")) == "Sensor(gelsight_mini, (240, 320) pixels, 20.3 mm wide)"


@pytest.mark.parametrize(
    ("error", "call", "message"),
    [
        (TypeError, lambda: vt.touch(3, SENSOR, np.eye(4)), "this is int"),
        (TypeError, lambda: vt.touch(BALL, None, np.eye(4)), "this is NoneType"),
        (TypeError, lambda: vt.touch(BALL, SENSOR, np.stack([np.eye(4)] * 2)), r"array \(2, 4, 4\); touch_many takes several"),
        (TypeError, lambda: vt.touch(BALL, SENSOR, "here"), "pose is .* this is str"),
        (TypeError, lambda: vt.touch(BALL, SENSOR, np.eye(4), object_pose=np.eye(3)), r"object_pose is .* an array \(3, 3\)"),
        (TypeError, lambda: vt.touch(BALL, SENSOR, np.eye(4), rng=3), "rng is a numpy.random.Generator"),
        (TypeError, lambda: vt.image(np.zeros(SENSOR.shape), SENSOR, 3), "rng is a numpy.random.Generator"),
        (TypeError, lambda: vt.press(np.zeros(SENSOR.shape), SENSOR, depth="deep"), "depth is a number, m; this is str"),
        (TypeError, lambda: vt.touch_many(BALL, SENSOR, np.zeros((2, 3, 3))), r"poses is \(N, 4, 4\) numbers"),
        (TypeError, lambda: vt.touch_many(BALL, SENSOR, [[1], [2, 3]]), "poses is .* this is list"),
        (TypeError, lambda: vt.touch_many(BALL, SENSOR, None), "poses is .* this is NoneType"),
        (TypeError, lambda: vt.touch_many(BALL, SENSOR, np.eye(4))[0:1], "slice"),
        (TypeError, lambda: vt.touch_many(BALL, SENSOR, np.eye(4), workers=0), "workers is a number of processes"),
        (TypeError, lambda: vt.untouched_image(3), "a sensor is the name of a shipped one, .* this is int"),
        (TypeError, lambda: vt.load_sensor(None), "a sensor is the name of a shipped one .* this is NoneType"),
        (TypeError, lambda: vt.load_object(("a", "b")), r"vertices \(V, 3\) and faces \(F, 3\) are arrays of numbers"),
        (TypeError, lambda: vt.load_object((MESH.vertices * 1j, MESH.faces)), "complex"),
        (TypeError, lambda: vt.load_object((MESH.vertices, MESH.faces), scale="mm"), "scale is metres per unit"),
        (TypeError, lambda: vt.load_object((MESH.vertices, MESH.faces), scale=np.complex128(1)), "complex"),
        (TypeError, lambda: vt.grasp(BALL, seed="x"), "seed is a whole number"),
        (vt.InvalidInput, lambda: vt.load_object("nope.obj"), r"nope\.obj: file not found"),
        (vt.InvalidInput, lambda: vt.load_object((MESH.faces, MESH.vertices)), "faces hold numbers of .* vertices, integers from 0"),
        (vt.InvalidInput, lambda: vt.load_object((MESH.vertices, MESH.faces + 10**6)), "these are int64 from 1000000"),
        (vt.InvalidInput, lambda: vt.load_object((MESH.vertices[:, :2], MESH.faces)), r"they must be \(V, 3\) and \(F, 3\)"),
        (vt.InvalidInput, lambda: vt.load_object((MESH.vertices, MESH.faces), scale=0), "scale is 0; it must be above 0"),
        (vt.InvalidInput, lambda: vt.touch(BALL, SENSOR, 2 * np.eye(4)), "not a rigid motion"),
        (vt.InvalidInput, lambda: vt.touch(BALL, SENSOR, np.eye(4), object_pose=np.diag([1, 1, -1, 1])), "^object_pose is not a rigid"),
        (vt.InvalidInput, lambda: vt.touch_many(BALL, SENSOR, [np.eye(4), 2 * np.eye(4)]), r"^poses\[1\] is not a rigid motion"),
        (vt.InvalidInput, lambda: vt.load_sensor("gelsight", shape=(240,)), r"image is \(rows, cols\); this is \(240,\)"),
        (vt.InvalidInput, lambda: vt.grasp(BALL, hand="alegro_right"), "there is no hand 'alegro_right', did you mean allegro_right?"),
        (vt.InvalidInput, lambda: vt.grasp(BALL, atempts=3), "there is no entry atempts, did you mean attempts?"),
    ],
)
def test_argument_that_cannot_be_used_is_named(error, call, message) -> None:
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize(("file", "scale", "size"), [("a.stl", 1e-3, 1), ("a.3mf", None, 1), ("a.3mf", 1, 1000)])
def test_scale_precedes_the_unit_that_a_file_states(tmp_path: Path, file: str, scale: float | None, size: float) -> None:
    MESH.copy().apply_scale(1000).export(tmp_path / file)  # 3MF states millimetres
    assert np.ptp(vt.load_object(tmp_path / file, scale=scale).mesh.vertices) == pytest.approx(2 * RADIUS * size, rel=1e-3)


def test_user_package_that_hides_ours_is_named(tmp_path: Path) -> None:
    (tmp_path / "stages").mkdir()
    (tmp_path / "stages" / "__init__.py").write_text("")
    root = Path(vt.__file__).parents[1]
    program = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(root)!r}]; import vt_pipeline"
    completed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert completed.returncode == 1
    assert "vt_pipeline needs its own package 'stages'" in completed.stderr
    assert str(tmp_path / "stages") in completed.stderr


@pytest.mark.slow
def test_touched_fingers_of_grasps_match_simulated_touches() -> None:
    mesh = trimesh.creation.cylinder(radius=0.03, height=0.4, sections=64).subdivide()
    bar = vt.load_object((mesh.vertices, mesh.faces))
    grasps = vt.grasp(bar, attempts=12, grasps=2, seed=1)
    assert grasps.fingers == ("index", "middle", "ring", "thumb")
    assert len(grasps) == 2
    for poses_of_grasp, touched in zip(grasps.sensor_pose, grasps.touched, strict=True):
        successes = [vt.touch(bar, sensor, pose).success for sensor, pose in zip(grasps.sensors, poses_of_grasp, strict=True)]
        assert successes == touched.tolist()
    assert grasps.touched.any()
    assert grasps.squeeze_angles.shape == grasps.pregrasp_angles.shape == grasps.joint_angles.shape
    assert grasps.held is None
    tested = vt.grasp(bar, attempts=12, grasps=2, seed=1, hold_test="six")
    assert tested.held is not None
    assert tested.held_directions is not None
    assert (tested.held.shape, tested.held_directions.shape) == ((2,), (2, 6))


def test_make_runs_a_stage_on_a_folder_of_meshes_once(tmp_path: Path) -> None:
    folder = tmp_path / "meshes"
    folder.mkdir()
    trimesh.creation.box().export(folder / "box.ply")
    options = {"settings": {"sample-surfaces.points": 100}, "workers": 1}
    texts = [vt.make("sample-surfaces", tmp_path / "data", folder, dry_run=dry, **options)[0].text for dry in (True, False, False)]
    assert [text.split(",")[0].split(" in ")[0] for text in texts] == ["would make 1 of 1 object", "made 1 object", "up to date"]
    with pytest.raises(vt.InvalidInput, match="did you mean sample-surfaces"):
        vt.make("sample-surface", tmp_path)
    assert vt.Dataset.__name__ == "GraspDataset"
