"""Observation files: poses in every form, all faults named at once, and objects located from depth and touches."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from pipeline.errors import InvalidInput
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.vision.camera import project_points
from pipeline.reconstruct.model_inputs import ModelInputs, used_inputs
from pipeline.reconstruct.object_box import find_object, shows_touch, turn_to_z
from pipeline.reconstruct.observation_checks import faults
from pipeline.reconstruct.observation_file import RobotObservation, load_observation
from pipeline.reconstruct.observation_placement import network_tactile_images, place_observation
from pipeline.reconstruct.observed_pose import Pose
from tests.reconstruct.robot import (
    CENTRE,
    RADIUS,
    SENSOR,
    TRAINING,
    camera_pose,
    model,
    scaled_pose,
    touch_pose,
    write_files,
    write_observation,
)


def error_of(path: Path, inputs: ModelInputs | None = None) -> str:
    with pytest.raises(InvalidInput) as error:
        load_observation(path, lambda part: faults(part, inputs))
    return str(error.value)


def test_valid_file_is_read_with_its_images(tmp_path: Path) -> None:
    path = write_observation(tmp_path, write_files(tmp_path))
    observation = load_observation(path, lambda part: faults(part, model()))
    assert observation.camera is not None
    assert observation.camera.image.shape == (120, 160, 3)
    assert observation.projection is not None
    np.testing.assert_allclose(project_points(observation.projection, CENTRE), [80, 60], atol=1e-9)
    assert len(repr(observation)) < 100


def test_all_faults_of_a_file_are_named_at_once(tmp_path: Path) -> None:
    """The file has unknown entries, a missing image, poses that are not rigid, a camera that looks away and a touch off the object."""
    entries = write_files(tmp_path)
    Image.new("L", (80, 60), 255).save(tmp_path / "small.png")
    entries["objekt"] = 3
    entries["camera"]["pose"] = (camera_pose() @ np.diag([1.0, -1, -1, 1])).tolist()
    far = touch_pose((0, 0, 1))
    far[2, 3] += 0.4
    entries["touches"] += [
        {"tactile_image": "ring.png", "pose": far.tolist()},
        {"tactile_image": "index.png", "pose": (2 * np.eye(4)).tolist()},
        {"tactile_image": "index.png", "pose": far.tolist(), "name": "ring"},
    ]
    message = error_of(write_observation(tmp_path, entries), model())
    for words in (
        "there is no entry objekt, did you mean object?",
        "touches.2.tactile_image: ",
        "ring.png cannot be read (No such file",
        "touches.3.pose: the last row is [0.0, 0.0, 0.0, 2.0]; it must be 0 0 0 1",
        "the camera does not see the object's centre, [0.4, -0.1, 0.2] m (as stated): with convention: opengl it would",
        "ring is 0.459 m from the object's centre",
        "Its entries are unit, up, object, camera",
    ):
        assert words in message
    entries["camera"]["mask"] = "small.png"
    assert "camera: mask has 80 x 60 pixels, the image 160 x 120" in error_of(write_observation(tmp_path, entries))


def test_positions_in_millimetres_without_a_unit_are_named(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    for touch in entries["touches"]:
        touch["pose"] = np.array(touch["pose"])
        touch["pose"][:3, 3] *= 1e3
        touch["pose"] = touch["pose"].tolist()
    message = error_of(write_observation(tmp_path, entries))
    assert "touches.0 pose is 400 m away (at most 10 m): write unit: mm if all lengths are in millimetres" in message
    assert "touches.1 pose is 400 m" in message


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ({"position": [0, 0, 0], "quaternion": [0, 0, 0, 2]}, "the quaternion has the length 2; it must be 1"),
        ({"position": [0, 0, 0], "quaternion": [0, 0, 0, 1], "rpy": [0, 0, 0]}, "a position and either a quaternion or rpy"),
        ({"position": [0, 0, 0]}, "a position and either a quaternion or rpy"),
        ({"position": [0, 0, 0], "quaternoin": [0, 0, 0, 1]}, "no entry touches.0.pose.quaternoin, did you mean quaternion?"),
        (np.diag([1.0, 1, -1, 1]).tolist(), "it mirrors"),
        (np.diag([1.0, 1.1, 1, 1]).tolist(), "it is not rigid: its axes are 0.21 from orthonormal"),
        (np.eye(3).tolist(), "touches.0.pose.matrix"),
        ([[float("nan")] * 4] * 4, "touches.0.pose.matrix"),
        ([[1e200, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "not rigid"),
        (7, "touches.0.pose"),
        ({"position": [0, 0, 0], "rpy": [98.5, -12, 170]}, "rpy is [98.5, -12.0, 170.0]: radians are within ± 2 π; are these degrees?"),
    ],
)
def test_invalid_poses_are_errors(tmp_path: Path, pose: object, words: str) -> None:
    entries = write_files(tmp_path)
    entries["touches"][0]["pose"] = pose
    assert words in error_of(write_observation(tmp_path, entries))


def test_pose_forms_are_equivalent_and_rounded_poses_are_made_rigid() -> None:
    turn = Rotation.from_euler("xyz", [0.3, -0.7, 2.0])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), [0.1, 0.2, 0.3]
    forms = [
        {"position": (0.1, 0.2, 0.3), "quaternion": tuple(turn.as_quat())},
        {"position": (0.1, 0.2, 0.3), "rpy": (0.3, -0.7, 2.0)},
        {"matrix": matrix.tolist()},
        matrix,
    ]
    for form in forms:
        np.testing.assert_allclose(Pose.model_validate(form).array, matrix, atol=1e-12)
    rounded = Pose.model_validate(np.round(matrix, 4)).array
    np.testing.assert_allclose(rounded, matrix, atol=1e-4)
    np.testing.assert_allclose(rounded[:3, :3].T @ rounded[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("changed", ["opengl", "inverse", "both"])
def test_camera_pose_in_another_convention_is_recognised(tmp_path: Path, changed: str) -> None:
    entries = write_files(tmp_path)
    pose = camera_pose() @ (np.diag([1.0, -1, -1, 1]) if changed != "inverse" else np.eye(4))
    entries["camera"]["pose"] = (pose if changed == "opengl" else np.linalg.inv(pose)).tolist()
    message = error_of(write_observation(tmp_path, entries))
    assert {
        "opengl": "with convention: opengl it would",
        "inverse": "with the inverse pose it would: give camera to frame",
        "both": "with the inverse pose and convention: opengl it would",
    }[changed] in message


@pytest.mark.parametrize(("file", "scale"), [("depth.png", 1e-4), ("depth.npy", 1e-3)])
def test_object_is_located_from_depth_and_mask(tmp_path: Path, file: str, scale: float) -> None:
    entries = write_files(tmp_path)
    del entries["object"]
    entries["camera"] |= {"depth": file, "depth_scale": scale}
    box = find_object(load_observation(write_observation(tmp_path, entries), faults), None)
    assert box is not None
    assert box.source == "estimated from depth and mask"
    assert np.linalg.norm(box.centre - CENTRE) < 0.25 * RADIUS
    assert box.diagonal == pytest.approx(2 * RADIUS * 3**0.5, rel=0.15)


def test_the_box_does_not_depend_on_how_the_frame_is_turned(tmp_path: Path) -> None:
    """Its axes are those of the network's world, where it stood when the network learned."""
    entries = write_files(tmp_path)
    del entries["object"]
    entries["camera"]["depth"] = "depth.npy"
    boxes = []
    for angle in (0.0, 0.6, 2.0):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
        entries["camera"]["pose"] = (turn @ camera_pose()).tolist()
        entries["touches"] = [touch | {"pose": (turn @ np.array(touch["pose"])).tolist()} for touch in write_files(tmp_path)["touches"]]
        box = find_object(load_observation(write_observation(tmp_path, entries)), model())
        assert box is not None
        boxes.append((*(box.centre @ turn[:3, :3]), box.diagonal))
    np.testing.assert_allclose(boxes, [boxes[0]] * 3, atol=1e-9)
    unturned = find_object(load_observation(write_observation(tmp_path, entries)), None)
    assert unturned is not None
    assert unturned.diagonal != pytest.approx(boxes[0][3], rel=1e-6)


def test_a_stated_diagonal_that_the_mask_contradicts_is_named(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    del entries["touches"], entries["sensor"]
    for diagonal, is_named in ((2 * RADIUS * 3**0.5, False), (0.02, True), (2.0, True)):
        entries["object"]["diagonal"] = diagonal
        placed = place_observation(load_observation(write_observation(tmp_path, entries)), model("unoccluded"))
        assert any("but object.diagonal is" in line for line in placed.remarks) == is_named


def test_depth_that_the_network_does_not_get_and_surfaces_without_patches_are_remarked(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    entries["camera"]["depth"] = "depth.npy"
    path = write_observation(tmp_path, entries)
    assert any("depth_as_touch: true would give it" in line for line in place_observation(load_observation(path), model()).remarks)
    mask = entries["camera"].pop("mask")
    unlocated = place_observation(load_observation(write_observation(tmp_path, entries)), model())
    assert "warning: camera.depth is not used without camera.mask: it neither locates the object nor is checked" in unlocated.remarks
    entries["camera"]["mask"] = mask
    depth = np.load(tmp_path / "depth.npy") + np.random.default_rng(0).normal(0, 0.01, (120, 160))
    np.save(tmp_path / "depth.npy", depth)
    entries["camera"]["depth_as_touch"] = True
    path = write_observation(tmp_path, entries)
    assert any("warning: 0 patches of the visible surface" in line for line in place_observation(load_observation(path), model()).remarks)


def test_an_observation_without_photograph_and_touches_is_a_fault(tmp_path: Path) -> None:
    entries = {"object": write_files(tmp_path)["object"]}
    inputs = replace(model(), configuration="any", config=model().config.model_copy(update={"image": "any"}))
    assert "model any needs a photograph or touches" in error_of(write_observation(tmp_path, entries), inputs)
    entries = write_files(tmp_path)
    entries["touches"], camera = [touch | {"touched": False} for touch in entries["touches"]], entries.pop("camera")
    assert "model any needs a photograph or touches" in error_of(write_observation(tmp_path, entries), inputs)
    entries["camera"] = camera
    observation = load_observation(write_observation(tmp_path, entries), lambda part: faults(part, inputs))
    assert not used_inputs(inputs.config, observation).touch
    load_observation(tmp_path / "grasp.yaml", lambda part: faults(part, model()))  # untouched sensors, as some of its grasps
    camera["depth"] = "gone.npy"
    del entries["touches"]
    message = error_of(write_observation(tmp_path, entries), inputs)
    assert "gone.npy" in message
    assert "needs a photograph" not in message  # there is one, which another fault took out


def test_depth_behind_the_rim_of_the_mask_is_left_out(tmp_path: Path) -> None:
    """A camera mixes the object's depth with that of the wall behind it."""
    entries = write_files(tmp_path)
    del entries["object"]
    entries["camera"]["depth"] = "depth.npy"
    exact = find_object(load_observation(write_observation(tmp_path, entries), faults), None)
    depth = np.load(tmp_path / "depth.npy")
    depth[~binary_erosion(np.nan_to_num(depth) > 0) & ~np.isnan(depth)] = 1.5
    np.save(tmp_path / "depth.npy", depth)
    mixed = find_object(load_observation(write_observation(tmp_path, entries), faults), None)
    assert exact is not None
    assert mixed is not None
    assert np.linalg.norm(mixed.centre - exact.centre) < 0.2 * RADIUS
    assert mixed.diagonal == pytest.approx(exact.diagonal, rel=0.15)


def test_object_is_not_located_by_a_single_pixel(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    del entries["object"], entries["touches"], entries["sensor"]
    depth = np.full_like(np.load(tmp_path / "depth.npy"), np.nan)
    depth[60, 80] = 0.5
    np.save(tmp_path / "pixel.npy", depth)
    entries["camera"]["depth"] = "pixel.npy"
    message = error_of(write_observation(tmp_path, entries))
    assert "object.centre is missing, and cannot be estimated: camera.depth is measured at only 1 pixel of camera.mask, 10 are" in message


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"depth": "depth.png"},
            "m from the camera, but its centre is 0.5 m away (as stated): check camera.depth_scale",
        ),  # its levels are tenths of a millimetre
        ({"depth": "mm.npy"}, "camera.depth shows the object 500 m away (at most 10 m): check camera.depth_scale; floats are metres"),
        ({"depth": "none.npy"}, "camera.depth is 0 or not finite wherever camera.mask shows the object"),
        ({"depth_as_touch": True}, "depth_as_touch needs depth:"),
        ({"depth_as_touch": True, "mask": None}, "depth_as_touch needs depth and mask:"),
    ],
)
def test_inconsistent_depth_is_named(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    entries = write_files(tmp_path)
    np.save(tmp_path / "none.npy", np.zeros((120, 160), np.float32))
    np.save(tmp_path / "mm.npy", np.full((120, 160), 500.0, np.float32))
    entries["camera"] |= changes
    assert words in error_of(write_observation(tmp_path, entries))


def test_depth_of_an_object_far_off_the_optical_axis_is_its_own(tmp_path: Path) -> None:
    """A ball 41 degrees off the axis: its depth along the axis is three quarters of its distance."""
    entries, slope = write_files(tmp_path), 0.87
    x, y = np.meshgrid((np.arange(160) + 0.5) / 300 + slope - 80 / 300, (np.arange(120) + 0.5 - 60) / 300)
    rays, centre = np.stack([x, y, np.ones_like(x)], axis=-1), np.array([slope, 0, 1.0])
    squared, along = (rays**2).sum(axis=-1), rays @ centre
    with np.errstate(invalid="ignore"):
        depth = (along - np.sqrt(along**2 - squared * (centre @ centre - RADIUS**2))) / squared
    np.save(tmp_path / "side.npy", depth)
    Image.fromarray(255 * (~np.isnan(depth)).astype(np.uint8)).save(tmp_path / "side.png")
    entries["camera"] |= {
        "depth": "side.npy",
        "mask": "side.png",
        "depth_as_touch": True,
        "intrinsics": {"fx": 300, "fy": 300, "cx": 80 - 300 * slope, "cy": 60},
    }
    del entries["object"], entries["touches"], entries["sensor"]
    observation = load_observation(write_observation(tmp_path, entries), lambda part: faults(part, model()))
    world = camera_pose()[:3, :3] @ centre + camera_pose()[:3, 3]
    np.testing.assert_allclose(find_object(observation, None).centre, world, atol=RADIUS / 2)


def test_faults_of_the_camera_are_named_beside_an_unknown_sensor(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    entries["sensor"], entries["camera"]["pose"] = "digitx", (camera_pose() @ np.diag([1.0, -1, -1, 1])).tolist()
    message = error_of(write_observation(tmp_path, entries))
    assert "digitx" in message
    assert "the camera does not see the object's centre" in message


def test_visible_points_are_passed_as_touches(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    entries["camera"] |= {"depth": "depth.npy", "depth_as_touch": True}
    del entries["touches"], entries["sensor"]
    observation = load_observation(write_observation(tmp_path, entries), lambda part: faults(part, model()))
    placed = place_observation(observation, model(centre=(0.1, 0.2, 0.7)))
    charts = placed.visible_charts(5)
    assert len(charts) > 10
    np.testing.assert_allclose(np.linalg.norm(charts - [0.1, 0.2, 0.7], axis=-1), 0.25 / 3**0.5, atol=2.5e-3)  # of a box of 0.5 m
    assert f"{len(charts)} patches of the visible surface are given as touched" in placed.remarks
    entries["camera"]["depth_as_touch"] = False
    assert "needs touches" in error_of(write_observation(tmp_path, entries), model())


def test_object_is_located_between_touches_or_its_centre_is_required(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    del entries["object"]
    box = find_object(load_observation(write_observation(tmp_path, entries), faults), None)
    assert box is not None
    assert box.diagonal is None
    np.testing.assert_allclose(box.centre, CENTRE, atol=1e-9)
    entries["touches"] = entries["touches"][:1]
    assert "object.centre is missing, and cannot be estimated: state it, or" in error_of(write_observation(tmp_path, entries))
    np.save(tmp_path / "none.npy", np.zeros((120, 160), np.float32))
    entries["camera"]["depth"] = "none.npy"
    assert "cannot be estimated: camera.depth is 0 or not finite wherever" in error_of(write_observation(tmp_path, entries))
    entries["camera"]["depth"] = "gone.npy"
    message = error_of(write_observation(tmp_path, entries))
    assert "gone.npy" in message
    assert "object.centre is missing" not in message  # the camera may give the centre


def test_missing_and_unsuitable_inputs_of_a_model_are_named(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    blind = {name: value for name, value in entries.items() if name not in ("camera", "touches", "sensor")}
    message = error_of(write_observation(tmp_path, blind), model())
    assert "model occluded-touch needs a photograph: add the entry camera" in message
    assert "model occluded-touch needs touches: add the entry touches" in message
    wide = SENSOR.model_copy(update={"width": 0.02, "name": "wide"})
    other = ModelInputs("touch", CONFIGURATIONS["touch"], None, None, None, wide)
    message = error_of(write_observation(tmp_path, entries), other)
    assert "sensor gel_16mm has 16.41 x 16.41 mm with a gel of 6.8 mm, the model's wide 20 x 20 mm" in message
    Image.new("RGB", (200, 100)).save(tmp_path / "index.png")
    Image.new("RGB", (200, 100)).save(tmp_path / "thumb.png")
    assert "tactile images have 200 x 100 pixels, another shape than the model's 100 x 100" in error_of(
        write_observation(tmp_path, entries), model()
    )


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_observation_is_moved_to_the_frame_of_the_network_and_back(tmp_path: Path, unit: float) -> None:
    entries = write_files(tmp_path)
    read = load_observation(write_observation(tmp_path, entries))
    scaled = [touch.changed(pose=scaled_pose(touch.pose, 1 / unit)) for touch in read.touches]
    assert read.camera is not None
    observation = RobotObservation(
        unit="m" if unit == 1 else "mm",
        object={"centre": tuple(CENTRE / unit)},
        camera=read.camera.changed(pose=scaled_pose(read.camera.pose, 1 / unit)),
        sensor=SENSOR,
        touches=tuple(scaled),
    )
    placed = place_observation(observation, model(centre=(0.1, 0.2, 0.7)))
    np.testing.assert_allclose(placed.returned(np.array([[0.1, 0.2, 0.7]])), [CENTRE / unit], atol=1e-9)
    expected = placed.to_network[:3, :3] @ (touch_pose((0, 1, 0))[:3, 3] - CENTRE) + [0.1, 0.2, 0.7]
    np.testing.assert_allclose(placed.sensor_poses[0, :3, 3], expected, atol=1e-12)
    np.testing.assert_allclose(placed.to_network[:3, 2], [0, 0, 1], atol=1e-12)  # up stays up
    assert placed.image is not None
    assert placed.image.shape == (128, 128, 3)
    row, col = np.nonzero(placed.image[..., 0] < 215)
    middle = project_points(TRAINING, np.array([0.1, 0.2, 0.7]))
    np.testing.assert_allclose([col.mean() + 0.5, row.mean() + 0.5], middle, atol=1)
    assert any("above its horizon" in line for line in placed.remarks)


def test_pixels_outside_the_mask_become_the_training_background(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    messy = np.array(Image.open(tmp_path / "seen.png"))
    messy[:, :40] = [10, 200, 10]  # a green cupboard
    Image.fromarray(messy).save(tmp_path / "seen.png")
    image = place_observation(load_observation(write_observation(tmp_path, entries)), model()).image
    assert image is not None
    assert not (image[..., 1].astype(int) - image[..., 0] > 30).any()
    assert (image[0, 0] == (230, 232, 235)).all()


def test_tactile_images_are_resampled_and_corrected_by_the_untouched_image_of_the_robot() -> None:
    rng = np.random.default_rng(0)
    base = np.full((*SENSOR.shape, 3), 100, np.uint8)
    pressed = base.copy()
    pressed[30:60, 30:60] = rng.integers(60, 190, 3, dtype=np.uint8)
    large = [np.repeat(np.repeat(image, 2, axis=0), 2, axis=1) for image in (pressed, base)]
    touch = {"tactile_image": large[0], "pose": np.eye(4)}
    plain = RobotObservation(sensor=SENSOR, touches=[touch])
    images = network_tactile_images(plain, SENSOR, base)
    assert images.shape == (1, *SENSOR.shape, 3)
    assert np.abs(images[0].astype(int) - pressed)[32:58, 32:58].max() <= 1
    np.testing.assert_array_equal(images[0][:25], base[:25])
    shifted = RobotObservation(sensor=SENSOR, untouched=large[1] + 20, touches=[{**touch, "tactile_image": large[0] + 20}])
    np.testing.assert_array_equal(network_tactile_images(shifted, SENSOR, base), images)


@pytest.mark.parametrize(
    "up", [(0, 0, 1), (0, -1, 0), (0, 0, -1), (1.5e-6, 0, -1), (1e-9, -1e-9, -1), (1e-300, 0, 0), (3e200, 1e200, -2e200), (0.1, 0.2, -0.99)]
)
def test_up_is_rotated_to_z(up: tuple[float, float, float]) -> None:
    turn = turn_to_z(np.array(up, float))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    direction = np.array(up) / np.abs(up).max()
    np.testing.assert_allclose(turn @ direction / np.linalg.norm(direction), [0, 0, 1], atol=1e-9)


def test_a_sensor_whose_image_shows_no_contact_does_not_locate_the_object(tmp_path: Path) -> None:
    entries = write_files(tmp_path)
    del entries["object"]
    untouched, touched = (np.full((20, 20, 3), 100, np.uint8) for _ in range(2))
    touched[8:12, 8:12] = 150
    for name, image in (("untouched", untouched), ("touched", touched)):
        Image.fromarray(image).save(tmp_path / f"{name}.png")
    entries["untouched"] = "untouched.png"
    away = copy.deepcopy(entries["touches"][0])
    away["pose"] = (np.array(away["pose"]) + np.eye(4)[:, 3] * np.array([[0.3], [0], [0], [0]])).tolist()
    entries["touches"] = [touch | {"touched": "auto", "tactile_image": "touched.png"} for touch in entries["touches"]]
    expected = find_object(load_observation(write_observation(tmp_path, entries)), None)
    entries["touches"].append(away | {"touched": "auto", "tactile_image": "untouched.png"})
    located = find_object(load_observation(write_observation(tmp_path, entries)), None)
    assert expected is not None
    assert located is not None
    np.testing.assert_array_equal(located.centre, expected.centre)


@pytest.mark.parametrize("noise", [0.0, 2.5])
def test_contact_shows_through_the_noise_of_single_pixels(tmp_path: Path, noise: float) -> None:
    entries, rng = write_files(tmp_path), np.random.default_rng(0)
    untouched, touched = (np.full((100, 100, 3), 100.0) for _ in range(2))
    touched[40:60, 40:60] += 15
    for name, image in (("untouched", untouched), ("empty", untouched), ("touched", touched)):
        Image.fromarray(np.rint(image + rng.normal(0, noise, image.shape)).astype(np.uint8)).save(tmp_path / f"{name}.png")
    entries["untouched"] = "untouched.png"
    names = ["empty" if number % 2 else "touched" for number in range(len(entries["touches"]))]
    entries["touches"] = [
        touch | {"touched": "auto", "tactile_image": f"{name}.png"} for touch, name in zip(entries["touches"], names, strict=True)
    ]
    observation = load_observation(write_observation(tmp_path, entries))
    assert [shows_touch(touch, observation) for touch in observation.touches] == [name == "touched" for name in names]
