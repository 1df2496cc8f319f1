"""Touches of any sensor in an observation, as photographs, depth of gels or points, and in a dataset: one rule for both."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from pipeline.errors import InvalidInput, StageError
from pipeline.formats.image_file import GEL_STEP, encode_image
from pipeline.formats.ply import read_points
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.transforms import rotation_from_euler, transform_points
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.depth_maps import gel_surface, press_gel
from pipeline.kernels.touch.sensor import pixel_centres, resample
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.models.foreign_data import as_learned, size_remarks
from pipeline.models.observation import Observation
from pipeline.models.touch_model import save_touch_model
from pipeline.real_touch import TouchReader, write_reading
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import place_observation
from pipeline.reconstruct.predict import PredictOptions, StoredGrasps, predict
from tests.engine.tiny_stages import publish
from tests.reconstruct.robot import CENTRE, RADIUS, target, touch_pose, write_files, write_observation
from tests.stages import ball_dataset as spheres

PRESSED = 8e-4  # m
SENSORS = {name: load_sensor(name) for name in ("gelsight_mini", "digit")}
SIDES = ((0, 1, 0), (0, -1, 0), (1, 0, 0))  # from which the ball is touched


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Make a network of any inputs and one of charts, with the U-Net of their sensor, `gel_16mm`, and a network of gels."""
    folder = tmp_path_factory.mktemp("models")
    for name in ("implicit-any", "implicit-gels"):
        spheres.make_implicit_model(folder, name)
    spheres.make_model(folder, "touch")
    (unet := folder / "made").mkdir()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        save_touch_model(unet, UNet(4), sensor=spheres.SENSOR, untouched=untouched_image(spheres.SENSOR), mask_threshold=1e-3)
    publish(folder, "models/unet", unet, "train-unet")
    return folder / "models"


def pose_of(direction, sensor) -> np.ndarray:
    """Place a sensor in a direction from the ball's centre, facing it, pressed in by `PRESSED`."""
    pose = touch_pose(direction)
    pose[:3, 3] = CENTRE - pose[:3, 2] * (RADIUS + sensor.w - PRESSED)
    return pose


def on_ball(sensor) -> np.ndarray:
    """Compute the depth D of the ball above such a sensor, m."""
    x, y = pixel_centres(sensor)
    return sensor.w - PRESSED + RADIUS - np.sqrt(RADIUS**2 - x[None] ** 2 - y[:, None] ** 2)


def photograph(sensor) -> np.ndarray:
    return render_gel(press_gel(on_ball(sensor), sensor).indentation, sensor, np.random.default_rng(0))


def given_as(kind: str, name: str, direction) -> dict:
    """Describe a touch of the ball by a sensor, as an entry of an observation."""
    sensor = SENSORS[name]
    entry = {"sensor": sensor, "pose": pose_of(direction, sensor).tolist(), "name": f"{kind} {name}"}
    pressed = np.maximum(gel_surface(sensor) - on_ball(sensor), 0)
    if kind == "photograph":
        return entry | {"tactile_image": photograph(sensor), "untouched": untouched_image(sensor)}
    if kind == "depth":
        return entry | {"depth": pressed, "contact": pressed > 0}
    row, col = np.nonzero(pressed > 0)
    x, y = pixel_centres(sensor)
    points = np.column_stack([x[col], y[row], on_ball(sensor)[row, col]])
    outward = ([0, 0, sensor.w - PRESSED + RADIUS] - points) / RADIUS  # into the ball
    return entry | {"points": np.hstack([points, outward])}


def observation(*touches: dict, **entries) -> RobotObservation:
    return RobotObservation(object={"centre": tuple(CENTRE), "diagonal": 2 * RADIUS * 3**0.5}, touches=touches, **entries)


def touches_of(observed: RobotObservation, models, name: str = "implicit-any-touch"):
    """Read the touches as the network is given them, moved back to the observation's frame."""
    reader = PredictOptions(models, name).reader()
    placed = place_observation(check(observed, reader.target))
    return [touch.moved(np.linalg.inv(placed.to_network)) for touch in reader.of_robot(placed).touches], placed.remarks


@pytest.mark.parametrize("network", ["implicit-any-touch", "implicit-gels-touch"])
@pytest.mark.parametrize(("kind", "error"), [("photograph", 5e-4), ("depth", 1e-4), ("points", 1e-4)])
def test_touches_of_several_sensors_become_points_of_the_ball(models, network, kind, error):
    given = [given_as(kind, name, direction) for name, direction in zip(SENSORS, SIDES, strict=False)]
    touches, remarks = touches_of(observation(*given), models, network)
    assert [touch.touched for touch in touches] == [True, True]
    for touch, sensor in zip(touches, SENSORS.values(), strict=True):
        assert touch.chart is None
        offset = touch.points - CENTRE
        assert np.sqrt(np.mean((np.linalg.norm(offset, axis=1) - RADIUS) ** 2)) < error
        assert np.median((touch.normals * offset).sum(axis=1)) > 0.99 * RADIUS
        assert touch.width == pytest.approx(sensor.width, rel=1e-6)
        assert len(touch.free) > 20 if network.startswith("implicit-gels") and kind != "points" else not len(touch.free)
    assert any("gels of gelsight_mini, digit are" in line for line in remarks) == (network == "implicit-any-touch")
    assert any("read by the pretrained network" in line for line in remarks) == (kind == "photograph")


def test_kinds_of_touch_and_charts_are_mixed_in_one_observation(models):
    """Photographs by the sensor of the network's charts still become charts; the order is that of the file."""
    sensor = spheres.SENSOR
    chart = {"tactile_image": photograph(sensor), "pose": pose_of(SIDES[2], sensor).tolist(), "touched": False}
    given = [given_as("depth", "digit", SIDES[0]), chart, given_as("points", "gelsight_mini", SIDES[1])]
    touches, _ = touches_of(observation(*given, sensor=sensor), models)
    assert [touch.chart is None for touch in touches] == [True, False, True]
    assert [touch.touched for touch in touches] == [True, False, True]


def test_gel_without_contact_is_the_square_that_a_network_of_charts_knows(models):
    sensor = SENSORS["digit"]
    entry = {"sensor": sensor, "pose": pose_of(SIDES[0], sensor).tolist(), "depth": np.zeros(sensor.shape)}
    (touch,), _ = touches_of(observation(entry), models)
    assert not touch.touched
    assert len(touch.free) == spheres.SIDE**2
    np.testing.assert_allclose(touch.free.mean(axis=0), pose_of(SIDES[0], sensor)[:3, 3], atol=1e-6)
    (touch,), _ = touches_of(observation(given_as("depth", "digit", SIDES[0]) | {"touched": False}), models)
    assert not touch.touched


def test_files_of_read_touch_give_the_touch_of_the_photograph(models, tmp_path):
    sensor = resample(SENSORS["gelsight_mini"], 120, 160)
    entries = write_files(tmp_path)
    Image.fromarray(photograph(sensor)).save(tmp_path / "a.png")
    Image.fromarray(untouched_image(sensor)).save(tmp_path / "untouched.png")
    reader = TouchReader("gelsight_mini", untouched_image(sensor))
    write_reading(reader.read(photograph(sensor)), tmp_path / "read", "a")
    pose = pose_of(SIDES[0], sensor).tolist()
    forms = (
        {"tactile_image": "a.png", "untouched": "untouched.png"},
        {"depth": "read/a-depth.png", "contact": "read/a-contact.png"},
        {"points": "read/a.ply"},
    )
    entries["touches"] = [form | {"sensor": "gelsight_mini", "pose": pose} for form in forms]
    del entries["camera"], entries["sensor"]
    observed = check(write_observation(tmp_path, entries)).observation
    (image, depth, points), _ = touches_of(observed, models)
    np.testing.assert_allclose(depth.points, image.points, atol=GEL_STEP)
    assert depth.points.shape == image.points.shape
    centres = np.linalg.norm(points.points.mean(axis=0) - image.points.mean(axis=0))
    assert centres < min(sensor.pitch)  # all pixels of the contact, not every few
    assert observed.changed().touches[2].cloud is not None


SENSOR = SENSORS["digit"]
POINT = np.array([[1e-3, 0, 4e-3, 0, 0, 1]])
REST = {"sensor": SENSOR, "pose": np.eye(4).tolist()}


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({}, "a touch has one of tactile_image, depth and points; this has none of them"),
        ({"depth": np.zeros((4, 4)), "points": np.zeros((1, 6))}, "this has depth and points"),
        ({"points": np.zeros((1, 6)), "contact": np.ones((4, 4), bool)}, "contact belongs to depth"),
        ({"depth": np.zeros((4, 4)), "untouched": np.zeros((4, 4, 3), np.uint8)}, "untouched belongs to tactile_image"),
        ({"depth": np.full((4, 4), np.inf)}, "depth holds NaN or infinity; it is how deep the gel is pressed in"),
        ({"depth": np.zeros((4, 4)), "contact": np.ones((4, 5), bool)}, "contact has 5 x 4 pixels, depth 4 x 4"),
        ({"points": np.zeros((4, 3))}, r"points are float64 \(4, 3\); they must be float64 \(N, 6\)"),
        ({"sensor": None, "depth": np.zeros((4, 4))}, "touches need the entry sensor"),
    ],
)
def test_touches_that_contradict_themselves_are_errors(entry, words):
    with pytest.raises(InvalidInput, match=words):
        observation(REST | entry)


@pytest.mark.parametrize(
    ("entry", "network", "words"),
    [
        ({"depth": on_ball(SENSOR)}, "implicit-any", "depth is up to .* mm, but the gel of digit is 5 mm high: give how deep the gel"),
        (
            {"depth": -np.eye(*SENSOR.shape) / 1e3},
            "implicit-any",
            "a, b: depth goes down to -.*turn its sign",
        ),
        ({"points": 1e3 * POINT}, "implicit-any", r"1 of 1 point outside the gel of digit, .* one at \[1000, 0, 4000\] mm: .*in m"),
        ({"points": POINT + [0.1, 0, 0, 0, 0, 0]}, "implicit-any", "outside the gel of digit.*give them in the sensor frame"),
        ({"points": POINT * [1, 1, 1, 1, 1, -1]}, "implicit-any", "normals of points do not point out of the gel.*turn them"),
        ({"points": POINT * [1, 1, 1, 0, 0, 0]}, "implicit-any", "normals of points do not point out of the gel"),
        ({"depth": np.zeros((50, 100))}, "implicit-any", "depth has 100 x 50 pixels, another shape than digit's 240 x 320"),
        ({"depth": np.zeros(SENSOR.shape)}, "touch", "takes touch charts of photographs by gel_16mm.*, and not depth or points: implicit"),
        (
            {"tactile_image": np.zeros((*SENSOR.shape, 3), np.uint8), "sensor": SENSOR.model_copy(update={"name": "mine"})},
            "implicit-any",
            "a, b: no pretrained network reads photographs of sensor mine: read them with `read-touch`",
        ),
        (
            {"tactile_image": np.zeros((*SENSOR.shape, 3), np.uint8), "sensor": SENSOR.model_copy(update={"w": 0.004})},
            "implicit-any",
            "the pretrained network for digit was trained for another sensor than the given digit: gel, w differ",
        ),
    ],
)
def test_touches_that_a_network_cannot_be_given_are_faults(models, entry, network, words):
    touch = {"sensor": SENSOR, "pose": pose_of(SIDES[0], SENSOR).tolist()} | entry
    observed = observation(touch | {"name": "a"}, touch | {"name": "b"}, accept_photographs=True)
    with pytest.raises(InvalidInput, match=words):
        check(observed, PredictOptions(models, network).reader().target)


def test_points_that_face_away_from_the_object_are_named(models):
    entry = given_as("points", "digit", SIDES[0])
    entry["pose"] = (np.array(entry["pose"]) @ np.diag([1, -1, -1, 1])).tolist()
    _, remarks = touches_of(observation(entry), models)
    assert any("face away from the object's centre: +z, and normals, must point out of the gel" in line for line in remarks)


@pytest.mark.parametrize("suffix", [".ply", ".npy"])
def test_files_without_normals_or_with_infinite_points_are_errors(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    header = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {name}\n" for name in "xyz")
    path.write_text(header + "end_header\n0 0 0\n")
    if suffix == ".npy":
        np.save(path, np.zeros((5, 3)))
    with pytest.raises(InvalidInput, match=r"a\.\w+ holds no points with normals: "):
        read_points(path)
    np.save(tmp_path / "far.npy", np.full((2, 6), np.inf))
    with pytest.raises(InvalidInput, match=r"has 2 points; at most .* all must be finite"):
        read_points(tmp_path / "far.npy")
    (tmp_path / "no.ply").write_bytes(encode_image(np.zeros((2, 2), np.uint8)))
    with pytest.raises(InvalidInput, match=r"no\.ply"):
        read_points(tmp_path / "no.ply")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("balls")
    spheres.make_data(folder, 1)
    return folder


def test_dataset_of_another_gel_is_given_as_points_with_the_remarks_of_an_observation(models, data, tmp_path):
    """Its charts are ignored: they are of a gel that the network has not learned."""
    other = shutil.copytree(models.parent, tmp_path / "other") / "models"
    unet = tmp_path / "made"
    unet.mkdir()
    mini = resample(SENSORS["gelsight_mini"], 64, 64)
    with torch.random.fork_rng():
        save_touch_model(unet, UNet(4), sensor=mini, untouched=untouched_image(mini), mask_threshold=1e-3)
    (other / "unet.json").unlink()
    publish(tmp_path / "other", "models/unet", unet, "train-unet")
    reader = PredictOptions(other, "implicit-any-touch").reader()
    seen = reader.of_object(data, "a", [2])
    assert all(touch.chart is None for touch in seen.touches if touch.touched)
    assert seen.touched.sum() == 3
    reach = np.concatenate([np.linalg.norm(touch.points - spheres.CENTRE, axis=1) for touch in seen.touches])
    np.testing.assert_allclose(reach, 0.1, atol=2e-4)
    predicted = predict(tmp_path / "a.ply", StoredGrasps(data, "a", [2]), PredictOptions(other, "implicit-any-touch"))
    assert any(line.startswith("warning: the object's diagonal is 0.346 m") for line in predicted.remarks)
    reader_of_charts = PredictOptions(other, "touch").reader()
    with pytest.raises(StageError, match="model touch takes touch charts of its sensor, not of gel_16mm: implicit networks"):
        reader_of_charts.of_object(data, "a", [2])
    own = PredictOptions(models, "implicit-any-touch").reader().of_object(data, "a", [2])  # of a U-Net with the dataset's gel
    assert all(touch.chart is not None for touch in own.touches)


def test_network_of_gels_reads_any_dataset_and_photographs_by_its_own_networks(models, data):
    reader = PredictOptions(models, "implicit-gels-touch").reader()
    seen = reader.of_object(data, "a", [0, 1])
    assert [touch.touched for touch in seen.touches] == [sensor != grasp for grasp in (0, 1) for sensor in range(4)]
    assert all(touch.touched != (len(touch.free) > 0) and touch.chart is None for touch in seen.touches)  # whole gels touch the ball
    assert reader.target.sensor == spheres.SENSOR
    reconstruction = reader.model.reconstruct([seen])[0]
    assert len(reconstruction.faces)
    entry = {"tactile_image": untouched_image(spheres.SENSOR), "pose": pose_of(SIDES[0], spheres.SENSOR).tolist()}
    (touch,), _ = touches_of(observation(entry, sensor=spheres.SENSOR), models, "implicit-gels-touch")  # by the U-Net
    assert not touch.touched
    assert len(touch.free)


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5])
def test_image_of_another_side_is_turned_with_its_touches_and_the_surface_turned_back(tmp_path, angle):
    """A scene that is turned as a whole, camera, touches and object, gives the surface turned."""
    spheres.make_model(tmp_path, "occluded-touch")
    model = PredictOptions(tmp_path / "models", "occluded-touch").reader().model
    trained = model.trained
    image = np.random.default_rng(0).integers(0, 256, (256, 256, 3), dtype=np.uint8)
    charts = spheres.chart_touches_of_ball()
    seen = Observation(image, charts, trained.projection)
    turn = np.eye(4)
    turn[:3, :3] = rotation_from_euler((0, 0, angle))
    turn[:3, 3] = spheres.CENTRE - turn[:3, :3] @ spheres.CENTRE
    given, remarks = as_learned(trained, seen.moved(turn))
    assert bool(remarks) == (angle != 0)
    expected, made = (model.reconstruct([item])[0].vertices for item in (seen, given))
    np.testing.assert_allclose(made, transform_points(turn, expected), atol=1e-4 if angle else 1e-9)


def test_image_of_other_pixels_is_zoomed_to_those_of_the_training(tmp_path):
    spheres.make_model(tmp_path, "unoccluded")
    model = PredictOptions(tmp_path / "models", "unoccluded").reader().model
    image = np.full((512, 512, 3), 230, np.uint8)
    image[200:300, 220:280] = 60
    halved = np.diag([2.0, 2.0, 1.0]) @ model.trained.projection
    given, _ = as_learned(model.trained, Observation(image, camera=halved))
    assert given.image.shape == (256, 256, 3)
    row, col = np.nonzero(given.image[..., 0] < 150)
    assert (row.min(), row.max(), col.min(), col.max()) == pytest.approx((100, 149, 110, 139), abs=1)
    model.reconstruct([given])


@pytest.mark.parametrize(
    ("diagonals", "width", "gels", "words"),
    [
        ([0.5], 0.0164, None, []),
        ([0.12], 0.0164, None, ["the object's diagonal is 0.12 m, the network has learned from objects of 0.5 m", "gels of"]),
        ([0.45, 0.55], 0.03, None, ["are 5.5 to 6.7 % of the object's diagonal wide, the network has learned from 3.3 %"]),
        ([0.1, 0.5], 0.02, (0.04, 0.2), ["the objects' diagonals are 0.1 to 0.5 m"]),
    ],
)
def test_sizes_and_gels_that_were_not_learned_are_named(diagonals, width, gels, words):
    sensor = SENSORS["digit"].model_copy(update={"width": width})
    trained = target("touch").model_copy(update={"gels": gels})
    remarks = [*size_remarks(trained, diagonals, [sensor], spheres.SENSOR)]
    assert len(remarks) == len(words)
    assert all(word in remark for word, remark in zip(words, remarks, strict=True))


def test_moved_observation_keeps_its_touches_relative_to_the_object():
    touch = spheres.chart_touches_of_ball()[0]
    seen = Observation(None, (touch,), scale=2.0, turn=0.7)
    placed = seen.scaled(spheres.CENTRE)
    np.testing.assert_allclose(np.linalg.norm(placed.touches[0].points - spheres.CENTRE, axis=1), 0.2, atol=1e-6)
    assert replace(placed, touches=()) == Observation(None)
