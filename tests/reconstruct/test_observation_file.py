"""Observation files: poses in every form, all faults named at once, and objects located from depth and touches."""

import copy

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from pipeline.errors import InvalidInput
from pipeline.kernels.vision.camera import project_points
from pipeline.reconstruct.object_location import turn_to_z
from pipeline.reconstruct.observation_checks import check, used_inputs
from pipeline.reconstruct.observation_entries import Pose
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import network_tactile_images, place_observation
from tests.reconstruct.robot import (
    CENTRE,
    RADIUS,
    SENSOR,
    TRAINING,
    camera_pose,
    scaled_pose,
    target,
    touch_pose,
    write_files,
    write_observation,
)

OPENGL_POSE = (camera_pose() @ np.diag([1.0, -1, -1, 1])).tolist()
DEPTH = "camera.depth is 0 or not finite wherever camera.mask shows the object"


@pytest.fixture
def entries(tmp_path):
    """Write the files of a valid observation."""
    return write_files(tmp_path)


@pytest.fixture
def error_of(tmp_path):
    def error(entries, target=None):
        with pytest.raises(InvalidInput) as error:
            check(write_observation(tmp_path, entries), target)
        return str(error.value)

    return error


@pytest.fixture
def box_of(tmp_path):
    return lambda entries, target=None: check(write_observation(tmp_path, entries), target).box


@pytest.fixture
def placed(tmp_path):
    return lambda entries, target: place_observation(check(write_observation(tmp_path, entries), target))


def test_valid_file_is_read_with_its_images(tmp_path, entries):
    observation = check(write_observation(tmp_path, entries), target()).observation
    assert observation.view is not None
    assert observation.view.camera.image.shape == (120, 160, 3)
    np.testing.assert_allclose(project_points(observation.view.matrix, CENTRE), [80, 60], atol=1e-9)
    assert len(repr(observation)) < 100


def test_all_faults_of_a_file_are_named_at_once(tmp_path, entries, error_of):
    """The file has unknown entries, a missing image, poses that are not rigid, a camera that looks away and a touch off the object."""
    Image.new("L", (80, 60), 255).save(tmp_path / "small.png")
    entries["objekt"] = 3
    entries["camera"]["pose"] = OPENGL_POSE
    far = touch_pose((0, 0, 1))
    far[2, 3] += 0.4
    entries["touches"] += [
        {"tactile_image": "ring.png", "pose": far.tolist()},
        {"tactile_image": "index.png", "pose": (2 * np.eye(4)).tolist()},
        {"tactile_image": "index.png", "pose": far.tolist(), "name": "ring"},
    ]
    message = error_of(entries, target())
    for words in (
        "there is no entry objekt, did you mean object?",
        "touches.2.tactile_image: ",
        "ring.png cannot be read (No such file",
        "touches.3.pose: the last row is [0.0, 0.0, 0.0, 2.0]; it must be 0 0 0 1",
        "the camera does not see the object's centre, [0.4, -0.1, 0.2] m (as stated): with convention: opengl it would",
        "ring is 0.459 m from the object's centre",
        "The file's entries are unit, up, object, camera",
    ):
        assert words in message
    entries["camera"]["mask"] = "small.png"
    assert "camera: mask has 80 x 60 pixels, the image 160 x 120" in error_of(entries)


def in_millimetres(entries):
    for touch in entries["touches"]:
        touch["pose"] = (np.diag([1e3, 1e3, 1e3, 1]) @ np.array(touch["pose"]) @ np.diag([1e-3, 1e-3, 1e-3, 1])).tolist()


def without(*names, **camera):
    """Remove entries, and change some of the camera."""

    def change(entries):
        for name in names:
            del entries[name]
        if camera:
            entries["camera"] |= camera

    return change


def diagonal_in_metres(entries):
    entries["unit"], entries["object"] = "mm", {"centre": [0, 0, 0], "diagonal": 0.5}


def one_touch(entries):
    del entries["object"]
    entries["touches"] = entries["touches"][:1]


def none_touches(entries):
    del entries["camera"]
    entries["touches"] = [touch | {"touched": False} for touch in entries["touches"]]


def wide_touches(entries):
    entries["touches"] = [touch | {"tactile_image": "wide.png"} for touch in entries["touches"]]


def unknown_sensor(entries):
    entries["sensor"], entries["camera"]["pose"] = "digitx", OPENGL_POSE


BLIND = without("camera", "touches", "sensor")
ANY = {"name": "occluded-touch", "image": "any"}


@pytest.mark.parametrize(
    ("change", "network", "faults", "absent"),
    [
        (in_millimetres, None, ["touches.0 pose is 400 m away (at most 10 m): write unit: mm", "touches.1 pose is 400 m"], ""),
        (diagonal_in_metres, None, ["object.diagonal is 0.5 mm (at least 0.001 m): check the unit, that of all lengths"], ""),
        (without(depth="depth.png"), None, ["m from the camera, but its centre is 0.5 m away (as stated)"], ""),  # tenths of a mm
        (without(depth="mm.npy"), None, ["camera.depth shows the object 500 m away (at most 10 m)"], ""),
        (without(depth="none.npy"), None, [DEPTH], ""),
        (without(depth_as_touch=True), None, ["depth_as_touch needs depth:"], ""),
        (without(depth_as_touch=True, mask=None), None, ["depth_as_touch needs depth and mask:"], ""),
        (one_touch, None, ["object.centre is missing, and cannot be estimated: state it"], ""),
        (without("object", "touches", depth="none.npy"), None, [f"object.centre is missing, and cannot be estimated: {DEPTH}"], ""),
        (without("object", "touches", depth="pixel.npy"), None, ["camera.depth is measured at only 1 pixel of camera.mask, 10 are"], ""),
        (without("object", "touches", depth="gone.npy"), None, ["gone.npy"], "object.centre is missing"),  # it may give the centre
        (BLIND, {}, ["occluded-touch needs a photograph: add the entry camera", "needs touches: add the entry touches"], ""),
        (BLIND, ANY, ["needs a photograph or touches"], ""),
        (none_touches, ANY, ["needs a photograph or touches"], ""),
        (without("touches", depth="gone.npy"), ANY, ["gone.npy"], "needs a photograph"),  # another fault took it out
        (lambda entries: entries.update(sensor="digitx"), {}, ["digitx"], "needs touches"),
        (
            lambda entries: entries.update(sensor="digit"),
            {},
            ["takes touch charts of photographs by gel_16mm, 16.41", "mm, and not a photograph by digit"],
            "",
        ),
        (without("touches", depth="depth.npy"), {}, ["needs touches"], ""),
        (wide_touches, {}, ["tactile images have 200 x 100 pixels, another shape than the model's 100 x 100"], ""),
        (unknown_sensor, None, ["digitx", "the camera does not see the object's centre"], ""),
        (without(pose=OPENGL_POSE), None, ["with convention: opengl it would"], ""),
        (without(pose=np.linalg.inv(camera_pose()).tolist()), None, ["with the inverse pose it would: give camera to frame"], ""),
        (without(pose=np.linalg.inv(OPENGL_POSE).tolist()), None, ["with the inverse pose and convention: opengl it would"], ""),
    ],
)
def test_faults_are_named(tmp_path, entries, error_of, change, network, faults, absent):
    Image.new("RGB", (200, 100)).save(tmp_path / "wide.png")
    pixel = np.full((120, 160), np.nan, np.float32)
    pixel[60, 80] = 0.5
    for name, depth in {"none": np.zeros_like(pixel), "mm": np.full_like(pixel, 500), "pixel": pixel}.items():
        np.save(tmp_path / f"{name}.npy", depth)
    change(entries)
    message = error_of(entries, None if network is None else target(**network))
    assert all(fault in message for fault in faults), message
    assert not absent or absent not in message


def test_untouched_sensors_are_an_input_of_a_network_with_touch(tmp_path, entries):
    entries["touches"] = [touch | {"touched": False} for touch in entries["touches"]]
    observation = check(write_observation(tmp_path, entries), target(**ANY)).observation
    assert not used_inputs(target(**ANY).network, observation).touch
    check(observation, target())  # as some of its grasps


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ({"position": [0, 0, 0], "quaternion": [0, 0, 0, 2]}, "the quaternion has the length 2; it must be 1"),
        ({"position": [0, 0, 0], "quaternion": [0, 0, 0, 1], "rpy": [0, 0, 0]}, "a position and either a quaternion or rpy"),
        ({"position": [0, 0, 0]}, "a position and either a quaternion or rpy"),
        ({"position": [0, 0, 0], "quaternoin": [0, 0, 0, 1]}, "no entry camera.pose.quaternoin, did you mean quaternion?"),
        (np.diag([1.0, 1, -1, 1]).tolist(), "it mirrors"),
        (np.diag([1.0, 1.1, 1, 1]).tolist(), "it is not rigid: its axes are 0.21 from orthonormal"),
        (np.eye(3).tolist(), "pose.matrix"),
        ([[float("nan")] * 4] * 4, "pose.matrix"),
        ([[1e200, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "not rigid"),
        (7, "pose"),
        ({"position": [0, 0, 0], "rpy": [98.5, -12, 170]}, "rpy is [98.5, -12.0, 170.0]: radians are within ± 2 π; are these degrees?"),
    ],
)
def test_invalid_poses_are_errors(pose, words):
    image = np.zeros((120, 160, 3), np.uint8)
    camera = {"image": image, "intrinsics": {"fx": 300, "fy": 300, "cx": 80, "cy": 60}, "pose": pose}
    with pytest.raises(InvalidInput) as error:
        RobotObservation(camera=camera)
    assert words in str(error.value)


def test_pose_forms_are_equivalent_and_rounded_poses_are_made_rigid():
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


@pytest.mark.parametrize(("file", "scale"), [("depth.png", 1e-4), ("depth.npy", 1e-3)])
def test_object_is_located_from_depth_and_mask(entries, box_of, file, scale):
    del entries["object"]
    entries["camera"] |= {"depth": file, "depth_scale": scale}
    box = box_of(entries)
    assert box.source == "estimated from depth and mask"
    assert np.linalg.norm(box.centre - CENTRE) < 0.25 * RADIUS
    assert box.diagonal == pytest.approx(2 * RADIUS * 3**0.5, rel=0.15)


def test_the_box_does_not_depend_on_how_the_frame_is_turned(entries, box_of):
    """Its axes are those of the network's world, where it stood when the network learned."""
    del entries["object"]
    entries["camera"]["depth"] = "depth.npy"
    boxes, touches = [], entries["touches"]
    for angle in (0.0, 0.6, 2.0):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
        entries["camera"]["pose"] = (turn @ camera_pose()).tolist()
        entries["touches"] = [touch | {"pose": (turn @ np.array(touch["pose"])).tolist()} for touch in touches]
        box = box_of(entries, target())
        boxes.append((*(box.centre @ turn[:3, :3]), box.diagonal))
    np.testing.assert_allclose(boxes, [boxes[0]] * 3, atol=1e-9)
    assert box_of(entries).diagonal != pytest.approx(boxes[0][3], rel=1e-6)


def test_depth_behind_the_rim_of_the_mask_is_ignored(tmp_path, entries, box_of):
    """A camera mixes the object's depth with that of the wall behind it."""
    del entries["object"]
    entries["camera"]["depth"] = "depth.npy"
    exact = box_of(entries)
    depth = np.load(tmp_path / "depth.npy")
    depth[~binary_erosion(np.nan_to_num(depth) > 0) & ~np.isnan(depth)] = 1.5
    np.save(tmp_path / "depth.npy", depth)
    mixed = box_of(entries)
    assert np.linalg.norm(mixed.centre - exact.centre) < 0.2 * RADIUS
    assert mixed.diagonal == pytest.approx(exact.diagonal, rel=0.15)


def test_depth_of_an_object_far_off_the_optical_axis_is_its_own(tmp_path, entries, box_of):
    """A ball 41 degrees off the axis: its depth along the axis is three quarters of its distance."""
    slope = 0.87
    x, y = np.meshgrid((np.arange(160) + 0.5) / 300 + slope - 80 / 300, (np.arange(120) + 0.5 - 60) / 300)
    rays, centre = np.stack([x, y, np.ones_like(x)], axis=-1), np.array([slope, 0, 1.0])
    squared, along = (rays**2).sum(axis=-1), rays @ centre
    with np.errstate(invalid="ignore"):
        depth = (along - np.sqrt(along**2 - squared * (centre @ centre - RADIUS**2))) / squared
    np.save(tmp_path / "side.npy", depth)
    Image.fromarray(255 * (~np.isnan(depth)).astype(np.uint8)).save(tmp_path / "side.png")
    intrinsics = {"fx": 300, "fy": 300, "cx": 80 - 300 * slope, "cy": 60}
    without("object", "touches", "sensor", depth="side.npy", mask="side.png", depth_as_touch=True, intrinsics=intrinsics)(entries)
    world = camera_pose()[:3, :3] @ centre + camera_pose()[:3, 3]
    np.testing.assert_allclose(box_of(entries, target()).centre, world, atol=RADIUS / 2)


def test_object_is_located_between_touches(entries, box_of):
    del entries["object"]
    box = box_of(entries)
    assert box.by_mask
    np.testing.assert_allclose(box.centre, CENTRE, atol=1e-9)
    del entries["camera"]["mask"]
    assert box_of(entries).diagonal is None


def test_a_sensor_whose_image_shows_no_contact_does_not_locate_the_object(tmp_path, entries, box_of):
    del entries["object"]
    untouched, touched = (np.full((20, 20, 3), 100, np.uint8) for _ in range(2))
    touched[8:12, 8:12] = 150
    for name, image in (("untouched", untouched), ("touched", touched)):
        Image.fromarray(image).save(tmp_path / f"{name}.png")
    entries |= {"untouched": "untouched.png", "accept_photographs": True}
    away = copy.deepcopy(entries["touches"][0])
    away["pose"] = (np.array(away["pose"]) + np.eye(4)[:, 3] * np.array([[0.3], [0], [0], [0]])).tolist()
    entries["touches"] = [touch | {"touched": "auto", "tactile_image": "touched.png"} for touch in entries["touches"]]
    expected = box_of(entries)
    entries["touches"].append(away | {"touched": "auto", "tactile_image": "untouched.png"})
    np.testing.assert_array_equal(box_of(entries).centre, expected.centre)


@pytest.mark.parametrize("noise", [0.0, 2.5])
def test_contact_shows_through_the_noise_of_single_pixels(noise):
    rng, untouched = np.random.default_rng(0), np.full((100, 100, 3), 100.0)
    touched = untouched.copy()
    touched[40:60, 40:60] += 15
    images = [np.rint(image + rng.normal(0, noise, image.shape)).astype(np.uint8) for image in (untouched, touched, untouched)]
    touches = [{"tactile_image": image, "pose": np.eye(4)} for image in images[1:]]
    observation = RobotObservation(sensor=SENSOR, untouched=images[0], touches=touches)
    assert observation.shown_touches.tolist() == [True, False]


def test_visible_points_are_passed_as_touches(entries, placed):
    without("touches", "sensor", depth="depth.npy", depth_as_touch=True)(entries)
    placement = placed(entries, target(centre=(0.1, 0.2, 0.7), side=5))
    charts = placement.visible_charts
    assert len(charts) > 10
    np.testing.assert_allclose(np.linalg.norm(charts - [0.1, 0.2, 0.7], axis=-1), 0.25 / 3**0.5, atol=2.5e-3)  # of a box of 0.5 m
    assert f"{len(charts)} patches of the visible surface are given as touched" in placement.remarks


def test_remarks_on_depth_and_sizes(tmp_path, entries, placed):
    def remarks(network, **camera):
        return "\n".join(placed(entries | {"camera": entries["camera"] | camera}, network).remarks)

    assert "depth_as_touch: true would give it" in remarks(target(), depth="depth.npy")
    assert "warning: camera.depth is not used without camera.mask" in remarks(target(), depth="depth.npy", mask=None)
    np.save(tmp_path / "rough.npy", np.load(tmp_path / "depth.npy") + np.random.default_rng(0).normal(0, 0.01, (120, 160)))
    assert "warning: 0 patches of the visible surface" in remarks(target(), depth="rough.npy", depth_as_touch=True)
    del entries["touches"], entries["sensor"]
    for diagonal, is_named in ((2 * RADIUS * 3**0.5, False), (0.02, True), (2.0, True)):
        entries["object"]["diagonal"] = diagonal
        assert ("but object.diagonal is" in remarks(target("unoccluded"))) == is_named


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_observation_is_moved_to_the_frame_of_the_network_and_back(tmp_path, entries, unit):
    read = check(write_observation(tmp_path, entries)).observation
    assert read.camera is not None
    observation = RobotObservation(
        unit="m" if unit == 1 else "mm",
        object={"centre": tuple(CENTRE / unit), "diagonal": 0.5 / unit},
        camera=read.camera.changed(pose=scaled_pose(read.camera.pose, 1 / unit)),
        sensor=SENSOR,
        touches=tuple(touch.changed(pose=scaled_pose(touch.pose, 1 / unit)) for touch in read.touches),
    )
    placed = place_observation(check(observation, target(centre=(0.1, 0.2, 0.7))))
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


def test_pixels_outside_the_mask_become_the_training_background(tmp_path, entries, placed):
    messy = np.array(Image.open(tmp_path / "seen.png"))
    messy[:, :40] = [10, 200, 10]  # a green cupboard
    Image.fromarray(messy).save(tmp_path / "seen.png")
    image = placed(entries, target()).image
    assert image is not None
    assert not (image[..., 1].astype(int) - image[..., 0] > 30).any()
    assert (image[0, 0] == (230, 232, 235)).all()


def test_tactile_images_are_resampled_and_corrected_by_the_untouched_image_of_the_robot():
    rng = np.random.default_rng(0)
    base = np.full((*SENSOR.shape, 3), 100, np.uint8)
    pressed = base.copy()
    pressed[30:60, 30:60] = rng.integers(60, 190, 3, dtype=np.uint8)
    large = [np.repeat(np.repeat(image, 2, axis=0), 2, axis=1) for image in (pressed, base)]
    touch = {"tactile_image": large[0], "pose": np.eye(4)}
    plain = RobotObservation(sensor=SENSOR, touches=[touch])
    images = network_tactile_images(plain, [0], SENSOR, base)
    assert images.shape == (1, *SENSOR.shape, 3)
    assert np.abs(images[0].astype(int) - pressed)[32:58, 32:58].max() <= 1
    np.testing.assert_array_equal(images[0][:25], base[:25])
    shifted = RobotObservation(sensor=SENSOR, untouched=large[1] + 20, touches=[{**touch, "tactile_image": large[0] + 20}])
    np.testing.assert_array_equal(network_tactile_images(shifted, [0], SENSOR, base), images)


@pytest.mark.parametrize(
    "up", [(0, 0, 1), (0, -1, 0), (0, 0, -1), (1.5e-6, 0, -1), (1e-9, -1e-9, -1), (1e-300, 0, 0), (3e200, 1e200, -2e200), (0.1, 0.2, -0.99)]
)
def test_up_is_rotated_to_z(up):
    turn = turn_to_z(np.array(up, float))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    direction = np.array(up) / np.abs(up).max()
    np.testing.assert_allclose(turn @ direction / np.linalg.norm(direction), [0, 0, 1], atol=1e-9)
