"""Photographs of a gel: read depth, contact, normals and points in them with a sensor's network, and train one for one's own sensor."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.description_file import description_path
from pipeline.formats.image_file import GEL_STEP, SUFFIXES, encode_image, image_files
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import gel_surface, press_gel, scaled_gel
from pipeline.kernels.touch.marker_removal import MarkerRemoval
from pipeline.kernels.touch.photograph_faults import photograph_faults, rim_change, stop_at, untouched_faults
from pipeline.kernels.touch.press_shapes import PressRanges, random_press
from pipeline.kernels.touch.sensor import Sensor, masked_points, resample, resample_longer_side
from pipeline.kernels.touch.shear_reading import DotReader, SlidDots
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.models.model_files import DESCRIPTION
from pipeline.models.shipped_weights import shipped_sensor_network
from pipeline.models.touch_model import LocalTouchModel, load_touch_model, save_touch_model
from pipeline.rng import numpy_rng
from pipeline.store.atomic import write_atomically
from pipeline.store.record import named_location
from pipeline.training.presses import Presses, SimulatedPress
from stages.train_touch import TouchTrainingSettings, train_local_network

ZARR = "touches.zarr"
MODEL_SUFFIX = "-touch"  # suffix of the folder beside a sensor file that holds its network: `my_gel-touch` beside `my_gel.yaml`
DEEPEST = 2**16 - 1
RIM_SHARE = 0.03
"""Share of the rim that shows a press, above which the rim counts as pressed. Of public photographs, 26 of 28 whose contact the rim cuts
have more, and 14 of 84 whose contact lies a radius or more away from it, because light drifts."""
INPUT_PIXELS = 160  # pixels along the longer side of a network's input, as in `simulate-presses`
PRESSES, WATCHED, STEPS = 4800, 16, 4800  # presses to train on, and to validate on; training steps, for any number of presses
GEL = (0.6, 1.5)
"""Least and greatest factor of the gel's thickness per press: photographs of balls do not determine it better. Much thinner gels touch the
object where thicker ones only sink beside it, and contact would become ambiguous."""
MIDDLE = 0.7
"""How far random presses may be from the gel's middle, in its sides: contacts that the rim cuts, as fingers make them, are read worst."""
DEEPER = 1.25
"""Random presses are up to this many times as deep as those that a sensor was calibrated with, for real gels give way more than modelled
ones."""
REMEDY = "train one with `vt-pipeline calibrate-sensor --train` or `vt-pipeline run train-touch`, and name its folder with --model"


@dataclass(frozen=True, eq=False)
class TouchReading:
    """Depth and contact that are read in a photograph."""

    indentation: NDArray[np.float32]  # (rows, cols) m, >= 0: how deep the gel's surface lies below its rest
    contact: NDArray[np.bool_]  # (rows, cols): where something touches
    sensor: Sensor  # with the photograph's pixels
    # whether the photograph shows a press at the rim: the gel may lie deeper than is read, for depth is measured from the part of the rim
    # that holds it, and is too small where that is pressed as well
    rim_pressed: bool
    slid: SlidDots | None = None  # of a reader of slides

    @property
    def normals(self) -> NDArray[np.float32]:
        """(rows, cols, 3) float32 unit normals of the gel's surface, sensor frame, out of the gel."""
        down, across = np.gradient(self._height, *self.sensor.pitch)
        normals = np.stack([-across, -down, np.ones_like(down)], axis=-1)
        return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True), np.float32)

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) float64 points of the gel's surface in the contact, sensor frame, m, row by row."""
        return masked_points(self._height, self.contact, self.sensor)

    @property
    def _height(self) -> NDArray[np.float64]:
        return np.asarray(gel_surface(self.sensor) - self.indentation.astype(np.float64))


class TouchReader:
    """Reads photographs of one sensor with its network.

    By default that is `NAME-touch` beside the sensor file, else the pretrained network for the sensor. Either must have been trained for
    the sensor as its file describes it, but for its pixels, its dots, and its gel's modulus and friction. Photographs that look altered as
    a whole are errors unless `accept_photographs`: by exchanged colours, turned, mirrored, grey, with another exposure, white balance,
    contrast or hue, of another sensor, or touched and untouched exchanged. Dots that are printed on the gel are filled in; a reader of
    slides also follows them from each photograph to the next, and reads shear, forces and torque. Its sensor has an elastic `gel`.
    """

    def __init__(
        self,
        sensor: str | Path,  # a sensor file, or the name of a built-in one: gives sides and gel
        untouched: NDArray[np.uint8],  # (rows, cols, 3), the photograph with nothing in the gel; the others have its pixels
        model: Path | None = None,  # a network of `train-touch`, DATA/models/touch, or the folder of one of `calibrate-sensor --train`
        device: str = "cpu",
        *,
        accept_photographs: bool = False,
        slides: bool = False,
    ) -> None:
        _check_photograph(untouched, "the untouched photograph")
        path = description_path("sensor", sensor)
        described = load_sensor(path)
        beside, shipped = path.with_name(path.stem + MODEL_SUFFIX), shipped_sensor_network(described.name)
        model = model and model.resolve()  # `.` has a name, too
        if model is not None and (named := named_location(model.with_name(f"{model.name}.json"))):  # of DATA/models/touch
            model = model.with_name(named)
        folder = model or (shipped if shipped and not (beside / DESCRIPTION).is_file() else beside)
        if not (folder / DESCRIPTION).is_file():
            raise InvalidInput(f"{folder} holds no network for sensor {path.stem}; {REMEDY}")
        loaded = load_touch_model(folder, device)
        if not isinstance(loaded, LocalTouchModel):
            raise InvalidInput(f"{folder} holds a U-Net, which reads simulated images; photographs are read by a network of `train-touch`")
        self.network = f"the pretrained network for {described.name}" if folder == shipped else str(folder)
        if model is None:
            loaded.check_description(
                described, self.network, f"{path} describes", f"{REMEDY}, or name {folder} there if larger errors do no harm"
            )
        self.pixel_aspect = described.pitch[0] / described.pitch[1]
        loaded.check_sides(*described.shape, self.pixel_aspect)
        self.model, self.described, self.accept_photographs = loaded, described, accept_photographs
        self.markers = MarkerRemoval(untouched)
        self.untouched = self.markers.fill(untouched)
        if not accept_photographs:
            stop_at(untouched_faults(self.untouched, described))
        rows, cols = untouched.shape[:2]
        loaded.check_sides(rows, cols, self.pixel_aspect)
        self.sensor = resample(described, rows, cols)
        self.dots = DotReader(untouched, self.sensor) if slides else None

    def read(self, image: NDArray[np.uint8]) -> TouchReading:
        """Read a photograph, (rows, cols, 3) uint8; an `InvalidInput` if it has other pixels than the untouched one, or looks altered."""
        _check_photograph(image, "it")
        photograph = image
        if image.shape == self.untouched.shape:
            image = self.markers.fill(image)
        if not self.accept_photographs:
            stop_at(photograph_faults(image, self.untouched, self.described))
        if image.shape != self.untouched.shape:
            size, needed = (f"{pixels.shape[1]} x {pixels.shape[0]}" for pixels in (image, self.untouched))
            raise InvalidInput(f"it has {size} pixels, the untouched photograph {needed}; take both with one size, and crop both alike")
        gel = self.model.read(image[None], self.untouched, self.pixel_aspect)
        rim_pressed = rim_change(image, self.untouched) > RIM_SHARE
        slid = self.dots.read(photograph, gel.indentation[0] * gel.contact[0]) if self.dots else None
        return TouchReading(gel.indentation[0], gel.contact[0], self.sensor, rim_pressed, slid)


def _check_photograph(image: NDArray[np.uint8], what: str) -> None:
    if (array := np.asarray(image)).dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3:
        raise InvalidInput(f"{what} is {array.dtype} {array.shape}; a photograph is uint8 (rows, columns, 3): red, green, blue")


def write_reading(reading: TouchReading, folder: Path, name: str) -> None:
    """Write a reading into a folder, which is made where it is missing, and its group of `ZARR`.

    `NAME-depth.png`, 16 bits, `GEL_STEP` m per level; `NAME-contact.png`, 255 in the contact; `NAME-normals.png`, (n + 1) / 2 as colours;
    `NAME.ply`, points in the contact with normals, m.
    """
    folder.mkdir(parents=True, exist_ok=True)
    normals = reading.normals
    levels = np.minimum(np.rint(reading.indentation.astype(np.float64) / GEL_STEP), DEEPEST).astype(np.uint16)
    pictures: dict[str, np.ndarray] = {
        "depth": levels,
        "contact": np.where(reading.contact, 255, 0).astype(np.uint8),
        "normals": np.rint(127.5 * (normals + 1)).astype(np.uint8),
    }
    for label, pixels in pictures.items():
        write_atomically(folder / f"{name}-{label}.png", encode_image(pixels), durable=False)
    write_atomically(folder / f"{name}.ply", _ply(reading.points, normals[reading.contact]), durable=False)
    group = zarr.open_group(folder / ZARR, mode="a").create_group(name, overwrite=True)
    group.attrs["rim_pressed"] = reading.rim_pressed
    arrays: dict[str, tuple[np.ndarray, tuple[str, ...], dict[str, Any]]] = {
        "indentation": (reading.indentation, ("row", "col"), {"units": "m"}),
        "contact": (reading.contact, ("row", "col"), {"units": "1"}),
        "normals": (normals, ("row", "col", "xyz"), {"units": "1", "frame": "sensor"}),
    }
    if (slid := reading.slid) is not None:
        shear, frame = slid.shear, {"frame": "sensor"}
        group.attrs.update(force=shear.force.tolist(), torque=shear.torque, misfit=shear.misfit, explained=shear.explained)
        arrays |= {
            "pressure": (shear.pressure.astype(np.float32), ("row", "col"), {"units": "Pa"}),
            "traction": (shear.traction.astype(np.float32), ("row", "col", "xy"), {"units": "Pa"} | frame),
            "shear": (shear.displacement.astype(np.float32), ("row", "col", "xy"), {"units": "m"} | frame),
            "marker": (slid.positions, ("marker", "xy"), {"units": "m"} | frame),
            "marker_displacement": (slid.moved, ("marker", "xy"), {"units": "m"} | frame),
        }
    for key, (values, dims, attributes) in arrays.items():
        group.create_array(key, data=np.ascontiguousarray(values), dimension_names=dims, attributes=attributes)


def _ply(points: NDArray[np.float64], normals: NDArray[np.float32]) -> bytes:
    """Write points with normals as binary PLY; no point makes an empty cloud."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")) + "end_header\n"
    return header.encode() + np.concatenate([points, normals], axis=1).astype("<f4").tobytes()


def photographs_of(
    path: Path,  # a photograph, or a folder of them
    untouched: Path,  # not listed
) -> list[Path]:
    """List photographs in the order of their names; an `InvalidInput` if there are none, or two would give output of the same name."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise InvalidInput(f"{path} does not exist; give a photograph, or a folder of them")
    files = image_files(path.iterdir(), untouched)
    if not files:
        raise InvalidInput(f"{path} holds no photographs besides the untouched one: files that end in {', '.join(SUFFIXES)}")
    for first, second in pairwise(sorted(files, key=lambda file: file.stem)):
        if first.stem == second.stem:
            raise InvalidInput(f"{first} and {second} have one name but for the suffix; rename one of them")
    return files


def camera_frames(number: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames, (rows, cols, 3), of a camera that OpenCV opens, until it gives no more."""
    try:
        import cv2
    except ImportError as error:
        raise InvalidInput("a camera needs OpenCV; `pip install -c constraints.txt -e '.[camera]'` installs it (50 MB)") from error
    capture: Any = cv2.VideoCapture(number)
    try:
        if not capture.isOpened():
            raise InvalidInput(f"OpenCV opens no camera {number}; is another program using it, or its number another one?")
        while True:
            received, frame = capture.read()
            if not received:
                return
            yield np.ascontiguousarray(frame[:, :, ::-1])  # BGR
    finally:
        capture.release()


def train_sensor_network(
    sensor: Sensor,
    *,
    seed: int = 0,  # of presses and training
    presses: int = PRESSES,  # to learn from
    settings: TouchTrainingSettings | None = None,  # by default those of `train-touch`, for `STEPS` steps
) -> tuple[LocalTouchModel, dict[str, Any]]:  # and facts about the training
    """Train a local network to read a sensor's photographs, from its file alone: random presses in memory, and no dataset."""
    if settings is None:
        settings = TouchTrainingSettings()
        settings = settings.model_copy(update={"epochs": max(1, round(STEPS * settings.batch_size / presses))})
    network_sensor = resample_longer_side(sensor, INPUT_PIXELS)
    training, watched = (
        random_presses(network_sensor, count, press_seed) for count, press_seed in ((presses, 2 * seed), (WATCHED, 2 * seed + 1))
    )
    with tempfile.TemporaryDirectory() as folder:
        network, facts = train_local_network(training, watched, settings, folder=Path(folder), seed=seed)
    return LocalTouchModel(network, training.sensor, training.untouched), facts


def random_presses(
    sensor: Sensor,  # with as many pixels as the images shall have
    count: int,
    seed: int,  # of all draws
    gel: tuple[float, float] = GEL,  # least and greatest factor of gel thickness or membrane width, drawn per press
) -> Presses:
    """Press random shapes into a sensor; they stay in memory."""
    least, most = PressRanges().depth
    deepest = min(DEEPER * sensor.calibrated.deepest, sensor.w / DEEPER) if sensor.calibrated else most
    ranges, presses = PressRanges(depth=(least, max(most, deepest)), middle=MIDDLE), []
    for number in range(count):
        rng = numpy_rng(seed, "random-presses", number)
        press = random_press(sensor, rng, ranges)
        varied = scaled_gel(sensor, rng.uniform(*gel))
        state = press_gel(press.depth, varied)
        presses.append(SimulatedPress(render_gel(state.indentation, varied, rng), state.indentation.astype(np.float32), state.contact))
    return Presses(sensor, untouched_image(sensor), [f"random press {number}" for number in range(count)], presses.__getitem__)


def save_sensor_network(model: LocalTouchModel, folder: Path) -> None:
    """Write a network into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    save_touch_model(folder, model.network, sensor=model.sensor, untouched=model.untouched)
