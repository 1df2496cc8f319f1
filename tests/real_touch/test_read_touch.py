"""`read-touch`: written files, cameras, and errors."""

import json
import shutil
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
import yaml
import zarr
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.image_file import GEL_STEP, read_depth, read_image
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.local_network import LocalNetwork
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.markers import MarkerGrid, draw_dots
from pipeline.kernels.touch.sensor import resample
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.models.shipped_weights import shipped_sensor_network
from pipeline.models.touch_model import LocalTouchModel, save_touch_model
from pipeline.real_touch import TouchReader, camera_frames, photographs_of, save_sensor_network, write_reading
from pipeline.store.digest import of_json
from tests.command_line import vt

ROWS, COLS = 36, 48
SENSOR = resample(load_sensor("gelsight"), ROWS, COLS).model_copy(update={"name": "my_gel"})
UNTOUCHED = untouched_image(SENSOR)


def ball(depth: float) -> NDArray[np.uint8]:
    y, x = np.mgrid[-1:1:36j, -1:1:48j] * 0.007
    return tactile_image(np.where(np.hypot(x, y) < 0.003, SENSOR.w - depth, np.inf), SENSOR)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a sensor file, an untrained network beside it, and three photographs."""
    folder = tmp_path_factory.mktemp("sensor")
    described = SENSOR.model_dump(mode="json", exclude_none=True)
    (folder / "my_gel.yaml").write_text(yaml.safe_dump(described))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = LocalNetwork(4).eval()
    save_sensor_network(LocalTouchModel(network, SENSOR, UNTOUCHED), folder / "my_gel-touch")
    (folder / "photographs").mkdir()
    for name, image in {"untouched": UNTOUCHED, "a": ball(0.001), "b": ball(0.0005)}.items():
        Image.fromarray(image).save(folder / "photographs" / f"{name}.png")
    return folder


@pytest.fixture(scope="module")
def reader(folder: Path) -> TouchReader:
    return TouchReader(folder / "my_gel.yaml", UNTOUCHED)


def test_network_of_the_current_folder_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "my_gel-touch")
    TouchReader(folder / "my_gel.yaml", read_image(folder / "photographs" / "untouched.png"), Path())


def test_network_of_a_data_directory_is_found_by_its_record(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "my_gel-touch", tmp_path / "models" / "touch-0123")
    record = {"location": "touch-0123"}
    (tmp_path / "models" / "touch.json").write_text(json.dumps({"checksum": of_json(record), **record}))
    reader = TouchReader(folder / "my_gel.yaml", UNTOUCHED, tmp_path / "models" / "touch")
    assert reader.network == str(tmp_path / "models" / "touch-0123")


def test_written_files_hold_the_reading(reader: TouchReader, tmp_path: Path) -> None:
    reading = reader.read(ball(0.001))
    reading = replace(reading, contact=reading.indentation >= np.median(reading.indentation))
    write_reading(reading, tmp_path / "out", "a")
    depth = read_depth(tmp_path / "out" / "a-depth.png") * GEL_STEP
    np.testing.assert_allclose(depth, np.minimum(reading.indentation, 65535 * GEL_STEP), rtol=0, atol=GEL_STEP)
    group = zarr.open_group(tmp_path / "out" / "touches.zarr", mode="r")
    arrays: Any = {name: group[f"a/{name}"] for name in ("indentation", "contact", "normals")}
    np.testing.assert_array_equal(arrays["indentation"][:], reading.indentation)
    np.testing.assert_array_equal(arrays["contact"][:], reading.contact)
    np.testing.assert_array_equal(arrays["normals"][:], reading.normals)
    assert arrays["indentation"].attrs["units"] == "m"
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "out" / "a-contact.png")) == 255, reading.contact)
    np.testing.assert_allclose(np.linalg.norm(reading.normals, axis=-1), 1, rtol=0, atol=1e-6)
    cloud: Any = trimesh.load(tmp_path / "out" / "a.ply")
    assert len(cloud.vertices) == reading.contact.sum()
    np.testing.assert_allclose(cloud.vertices, reading.points, rtol=0, atol=1e-8)
    object.__setattr__(reading, "contact", np.zeros_like(reading.contact))
    zarr.open_group(tmp_path / "out" / "touches.zarr")["a"].create_array("shear", data=np.zeros(2))  # of a slide
    write_reading(reading, tmp_path / "out", "a")  # replaces the first
    assert "shear" not in zarr.open_group(tmp_path / "out" / "touches.zarr")["a"]
    assert b"element vertex 0\n" in (tmp_path / "out" / "a.ply").read_bytes()


def test_normals_follow_the_surface_of_the_gel(reader: TouchReader) -> None:
    reading = reader.read(ball(0.001))
    x = (np.arange(COLS) + 0.5) / COLS * SENSOR.width
    object.__setattr__(reading, "indentation", np.broadcast_to(0.5 * x, (ROWS, COLS)).astype(np.float32))
    np.testing.assert_allclose(reading.normals[5, 5], np.array([0.5, 0, 1]) / np.sqrt(1.25), rtol=0, atol=1e-5)


def test_command_reads_all_photographs_of_a_folder_but_the_untouched_one(folder: Path, tmp_path: Path) -> None:
    photographs = folder / "photographs"
    options = ["--untouched", photographs / "untouched.png", "--sensor", folder / "my_gel.yaml", "--out", tmp_path / "out"]
    printed = vt("read-touch", photographs, *options)
    assert "2 photographs" in printed
    assert "read by " in printed
    assert {file.name for file in (tmp_path / "out").glob("*-depth.png")} == {"a-depth.png", "b-depth.png"}


class Capture:
    """A camera with two frames and the interface of OpenCV."""

    def __init__(self, number: int) -> None:
        self.frames = [np.full((2, 3, 3), (1, 2, 3), np.uint8)] * 2 if number == 0 else []
        self.released = False

    def isOpened(self) -> bool:
        return bool(self.frames)

    def read(self) -> tuple[bool, Any]:
        return (True, self.frames.pop()) if self.frames else (False, None)

    def release(self) -> None:
        self.released = True


def test_camera_frames_are_converted_to_rgb(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", types.SimpleNamespace(VideoCapture=Capture))
    frames = list(camera_frames(0))
    assert [frame[0, 0].tolist() for frame in frames] == 2 * [[3, 2, 1]]
    with pytest.raises(InvalidInput, match="OpenCV opens no camera 1"):
        next(camera_frames(1))
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InvalidInput, match=r"\.\[camera\]"):
        next(camera_frames(0))


def test_network_beside_the_sensor_file_precedes_the_shipped_one_and_both_require_the_same_sensor(folder: Path, tmp_path: Path) -> None:
    untouched = untouched_image(load_sensor("gelsight_mini", shape=(ROWS, COLS)))
    ships = "the pretrained network for gelsight_mini"
    shipped = TouchReader("gelsight_mini", untouched)
    assert shipped.network == ships
    copy = tmp_path / "gelsight_mini.yaml"
    described = yaml.safe_load(description_path("sensor", "gelsight_mini").read_text())
    stiff = described["gel"] | {"modulus": 1e5}
    copy.write_text(yaml.safe_dump(described | {"rows": 120, "cols": 160, "gel": stiff}))
    assert TouchReader(copy, untouched).network == ships  # the same images in other sizes
    copy.write_text(yaml.safe_dump(described | {"gel": described["gel"] | {"thickness": 0.003}, "w": 0.005}))
    with pytest.raises(InvalidInput, match=f"{ships} was trained for another sensor than {copy} describes: gel, w differ; train one"):
        TouchReader(copy, untouched)
    named = shipped_sensor_network("gelsight_mini")
    assert TouchReader(copy, untouched, named).network == ships
    shutil.copytree(folder / "my_gel-touch", beside := tmp_path / "gelsight_mini-touch")
    with pytest.raises(InvalidInput, match=r"gelsight_mini-touch was trained for another sensor .*: calibrated, .*name, .* differ"):
        TouchReader(copy, untouched)
    assert TouchReader(copy, untouched, beside).network == str(beside)


def test_photographs_whose_pixels_are_not_square_are_read(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "my_gel-touch", tmp_path / "my_gel-touch")
    described = yaml.safe_load((folder / "my_gel.yaml").read_text())
    (tmp_path / "my_gel.yaml").write_text(yaml.safe_dump(described | {"rows": 32}))
    low = resample(SENSOR, 32, COLS)
    reading = TouchReader(tmp_path / "my_gel.yaml", untouched_image(low)).read(untouched_image(low))
    assert reading.sensor.pitch == pytest.approx((SENSOR.height / 32, SENSOR.width / COLS))
    with pytest.raises(InvalidInput, match="crop them to what the sensor file describes"):
        TouchReader(tmp_path / "my_gel.yaml", UNTOUCHED)


def test_dots_that_move_on_the_gel_are_filled_in(folder: Path) -> None:
    fine = resample(SENSOR, 4 * ROWS, 4 * COLS)
    markers = MarkerGrid(rows=6, cols=8, radius=5 * fine.pitch[1], colour=(5, 5, 5))
    untouched = untouched_image(fine)
    y, x = np.mgrid[-1:1:144j, -1:1:192j] * 0.007
    pressed = tactile_image(np.where(np.hypot(x, y) < 0.003, fine.w - 0.001, np.inf), fine)

    def printed(image: NDArray[np.uint8], pixels: float) -> NDArray[np.uint8]:
        moved = np.full((*fine.shape, 2), pixels * fine.pitch[1])
        draw_dots(dotted := image.copy(), moved, fine.pitch, markers.positions(fine.width, fine.height), markers.radius, markers.colour)
        return dotted

    plain = TouchReader(folder / "my_gel.yaml", untouched).read(pressed)
    reader = TouchReader(folder / "my_gel.yaml", printed(untouched, 0))
    filled = reader.read(printed(pressed, 4)).indentation
    dotted = reader.model.read(printed(pressed, 4)[None], printed(untouched, 0)).indentation[0]
    errors = [float(np.abs(read - plain.indentation).mean()) for read in (filled, dotted)]
    assert errors[0] < 0.25 * errors[1]


def test_photographs_with_negative_strides_are_read(reader: TouchReader) -> None:
    image = ball(0.001)
    turned = image[..., ::-1].copy()[..., ::-1]  # negative strides, as after conversion from BGR
    np.testing.assert_array_equal(reader.read(turned).indentation, reader.read(image).indentation)


def test_arrays_that_are_no_photographs_are_refused(reader: TouchReader, folder: Path) -> None:
    for array in (UNTOUCHED[..., 0], UNTOUCHED / 255, np.dstack([UNTOUCHED, UNTOUCHED])):
        with pytest.raises(InvalidInput, match=r"it is \w+ \(.*\); a photograph is uint8 \(rows, columns, 3\)"):
            reader.read(array)
        with pytest.raises(InvalidInput, match="the untouched photograph is"):
            TouchReader(folder / "my_gel.yaml", array)


def test_unusable_photographs_and_networks_are_errors(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "unet").mkdir()
    save_touch_model(tmp_path / "unet", UNet(1), sensor=SENSOR, untouched=UNTOUCHED, mask_threshold=1e-3)
    (tmp_path / "twins").mkdir()
    for suffix in ("png", "bmp"):
        Image.fromarray(UNTOUCHED).save(tmp_path / "twins" / f"a.{suffix}")
    for call, message in (
        (lambda: photographs_of(tmp_path / "missing", tmp_path), "does not exist; give a photograph"),
        (lambda: photographs_of(tmp_path, tmp_path), "holds no photographs besides the untouched one"),
        (lambda: photographs_of(tmp_path / "twins", tmp_path), r"a.* and .*a.* have one name but for the suffix; rename one"),
        (lambda: TouchReader("gel_16mm", UNTOUCHED), "holds no network for sensor gel_16mm; train one"),
        (lambda: TouchReader(folder / "my_gel.yaml", UNTOUCHED, tmp_path / "unet"), "holds a U-Net, which reads simulated images"),
    ):
        with pytest.raises(InvalidInput, match=message):
            call()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "name photographs, or a camera with --camera"),
        (["PHOTOGRAPHS", "--out", "PHOTOGRAPHS"], "is the folder of the photographs"),
        (["PHOTOGRAPHS", "--frames", "1"], "--frames 1 ends --camera"),
    ],
)
def test_options_that_exclude_each_other_are_errors(folder: Path, options: list[str], words: str) -> None:
    photographs = str(folder / "photographs")
    given = [photographs if option == "PHOTOGRAPHS" else option for option in options]
    before = sorted((folder / "photographs").iterdir())
    command = ["read-touch", *given, "--untouched", f"{photographs}/untouched.png", "--sensor", folder / "my_gel.yaml"]
    assert words in vt(*command, fails=True)
    assert sorted((folder / "photographs").iterdir()) == before


def test_slides_are_followed_by_their_dots_from_photograph_to_photograph(tmp_path: Path, folder: Path) -> None:
    """A blind network sees no press: the dots alone tell that the gel is sheared, which is said."""
    network = LocalNetwork(4)
    for parameter in network.parameters():
        torch.nn.init.zeros_(parameter)
    save_sensor_network(LocalTouchModel(network, SENSOR, UNTOUCHED), tmp_path / "blind")
    sensor = resample(SENSOR, 96, 128)
    dots = MarkerGrid(rows=5, cols=6, radius=5e-4).positions(sensor.width, sensor.height)
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    for name, shift in {"untouched": 0.0, "a": 0.0, "b": 1e-4, "c": 2e-4}.items():
        image = untouched_image(sensor).copy()
        draw_dots(image, np.full((96, 128, 2), (shift, 0.0)), sensor.pitch, dots, 5e-4, (0, 0, 0))
        if name == "c":
            image[:20, :20] = untouched_image(sensor)[:20, :20]  # a dot is covered
        Image.fromarray(image).save(photographs / f"{name}.png")
    options = ["--untouched", photographs / "untouched.png", "--sensor", folder / "my_gel.yaml", "--model", tmp_path / "blind", "--slides"]
    printed = " ".join(vt("read-touch", photographs, *options, "--out", tmp_path / "out").split())
    assert "force 0.000 0.000 0.000 N" in printed
    assert printed.count("what moves the dots does not show in the photograph") == 2
    assert "1 of 30 dots lost" in printed
    assert "friction is not known" in printed
    group = zarr.open_group(tmp_path / "out" / "touches.zarr")["b"]
    assert group["marker_displacement"].attrs["units"] == "m"
    np.testing.assert_allclose(group["marker_displacement"][:], np.tile([1e-4, 0], (30, 1)), rtol=0, atol=0.1 * sensor.pitch[0])
    assert group["shear"].shape == group["traction"].shape == (96, 128, 2)
    assert group.attrs["force"][0] > 0
    assert not group.attrs["explained"]
    vt("read-touch", photographs, *options[:-1], "--out", tmp_path / "out")
    group = zarr.open_group(tmp_path / "out" / "touches.zarr")["b"]
    assert sorted(group.array_keys()) == ["contact", "indentation", "normals"]  # nothing is left of the first reading
    assert list(group.attrs) == ["rim_pressed"]


def test_network_stays_that_of_a_sensor_whose_file_gets_dots(folder: Path, tmp_path: Path) -> None:
    """They are filled in before it reads."""
    shutil.copytree(folder, tmp_path / "dotted")
    path = tmp_path / "dotted" / "my_gel.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"markers": {"rows": 3, "cols": 4, "radius": 5e-4}}))
    TouchReader(path, UNTOUCHED)
