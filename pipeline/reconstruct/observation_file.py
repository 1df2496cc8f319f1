"""Observations of a robot: what it saw and felt of one object, as a YAML file or as arrays."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator
from scipy.ndimage import uniform_filter

from pipeline.console import pluralise
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import entry_names, invalid_entries, read_yaml, with_entries
from pipeline.formats.file_units import METRES
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import foreground
from pipeline.reconstruct.observation_entries import Depth, FileEntries, Image, Mask, Pose, SensorName, Vector, check_array, size_text
from pipeline.reconstruct.observed_touch import ObservedTouch

MAX_TOUCHES = 256
CHANGED, CONTACT_SHARE = 8, 0.5  # levels by which a share of the pixels, %, differs from the untouched image in a touch
SMOOTHED = 1 / 33  # share of a tactile image's shorter side over which differences are averaged before: noise of single pixels is no touch


class ObservedObject(FileEntries):
    """Where the object is."""

    centre: Vector | None = Field(default=None, description="of its bounding box; by default from `depth` and `mask`, else touches")
    diagonal: float | None = Field(
        default=None, gt=0, description="of its bounding box; by default estimated from `depth` and `mask`, or `mask` alone"
    )


class Intrinsics(FileEntries):
    """Focal lengths and principal point, pixels; the centre of the top left pixel is (½, ½)."""

    fx: float = Field(ge=10, le=1e6, description="focal length along columns")
    fy: float = Field(ge=10, le=1e6, description="focal length along rows")
    cx: float = Field(ge=-1e6, le=1e6, description="column of the principal point; OpenCV's and ROS's plus ½")
    cy: float = Field(ge=-1e6, le=1e6, description="row of the principal point; OpenCV's and ROS's plus ½")


class ObservedCamera(FileEntries):
    """A rectified photograph and its camera."""

    image: Image = Field(description="8-bit RGB photograph, without distortion")
    intrinsics: Intrinsics = Field(description="of the photograph")
    pose: Pose = Field(description="camera to the file's frame: an extrinsic, as from hand-eye calibration")
    convention: Literal["opencv", "opengl"] = Field(
        default="opencv", description="`opencv` and ROS's optical frames look along +z, +y down; `opengl` and Blender along -z, +y up"
    )
    mask: Mask | None = Field(
        default=None, description="not 0 where the photograph shows the object; without it, all that differs in colour from the border"
    )
    hand_mask: Mask | None = Field(default=None, description="not 0 where it shows the robot in front of the object")
    depth: Depth | None = Field(default=None, description="along the viewing direction, registered to the image: 16-bit PNG, or .npy, m")
    depth_scale: float = Field(default=1e-3, gt=0, le=1, description="m per level of a 16-bit depth image; 0.001 for mm")
    depth_as_touch: bool = Field(
        default=False, description="give networks with touch visible points of `depth`: for errors up to 0.4 % of its size; needs `mask`"
    )

    @model_validator(mode="after")
    def _is_one_size(self) -> Self:
        check_array("image", self.image, np.uint8, 3)
        levels = self.depth.dtype if self.depth is not None and self.depth.dtype.kind == "f" else np.uint16
        for name, dtype in (("mask", np.bool_), ("hand_mask", np.bool_), ("depth", levels)):
            if (array := getattr(self, name)) is None:
                continue
            check_array(name, array, dtype, 2)
            if array.shape != self.image.shape[:2]:
                raise ValueError(f"{name} has {size_text(array)} pixels, the image {size_text(self.image)}; register them")
        if self.mask is not None and not self.mask.any():
            raise ValueError("the mask is 0 everywhere; the object's pixels must not be")
        if lacking := [name for name in ("depth", "mask") if getattr(self, name) is None and self.depth_as_touch]:
            raise ValueError(f"depth_as_touch needs {' and '.join(lacking)}: they select the object's points")
        return self

    @cached_property
    def metres(self) -> NDArray[np.float64] | None:
        """(rows, cols) depth, m; NaN where nothing was measured: at 0, negative and infinite numbers."""
        if self.depth is None:
            return None
        depth = self.depth.astype(np.float64) * (self.depth_scale if self.depth.dtype == np.uint16 else 1.0)
        return np.where(np.isfinite(depth) & (depth > 0), depth, np.nan)

    @cached_property
    def object_pixels(self) -> NDArray[np.bool_]:
        """(rows, cols): where the photograph shows the object, by its mask or else by its border's colour, and not the robot."""
        mask = foreground(self.image) if self.mask is None else self.mask
        return mask if self.hand_mask is None else mask & ~self.hand_mask

    @cached_property
    def measured(self) -> NDArray[np.bool_] | None:
        """(rows, cols): the object's pixels whose depth is known; None without a depth image or a mask."""
        return None if self.metres is None or self.mask is None else self.object_pixels & ~np.isnan(self.metres)


@dataclass(frozen=True)
class View:
    """A photograph and its projection."""

    camera: ObservedCamera
    matrix: NDArray[np.float64]  # (3, 4): the observation's frame, m, to pixels

    def shows(self, point: NDArray[np.float64]) -> bool:
        """Check whether a point (3,) of the frame, m, is in the photograph."""
        rows, cols = self.camera.image.shape[:2]
        pixel = project_points(self.matrix, point)
        return bool(((pixel >= 0) & (pixel < [cols, rows])).all())  # NaN behind the camera is not


class RobotObservation(FileEntries):
    """A robot's observation of one static object, in one frame (e.g. its base)."""

    unit: Literal["mm", "cm", "dm", "m", "in", "ft"] = Field(default="m", description="of all lengths, and of the reconstruction")
    up: Vector = Field(default=(0, 0, 1), description="direction against gravity in the file's frame: networks know objects upright")
    object: ObservedObject = Field(default=ObservedObject(), description="where the object is")
    camera: ObservedCamera | None = Field(default=None, description="photograph and camera; needed by networks with an image")
    sensor: SensorName | None = Field(default=None, description="name or file of the sensors' description; needed with touches")
    untouched: Image | None = Field(
        default=None, description="tactile image of the sensor without contact; by default the one that the model was trained with"
    )
    accept_photographs: bool = Field(
        default=False, description="accept what seems altered: colours exchanged, turned, mirrored, grey, another exposure or sensor"
    )
    touches: tuple[ObservedTouch, ...] = Field(
        default=(), max_length=MAX_TOUCHES, description=f"at most {MAX_TOUCHES}; networks with touch need some, or `depth_as_touch`"
    )

    def __init__(self, **entries: Any) -> None:
        try:
            super().__init__(**entries)
        except ValidationError as error:
            faults = invalid_entries(error, entry_names(RobotObservation))
            raise InvalidInput(with_entries(f"observation: {faults}", RobotObservation)) from error

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # `model_validate` does without it, and keeps its context

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.sensor is None and any(touch.sensor is None for touch in self.touches):
            raise ValueError("touches need the entry sensor: a built-in sensor's name, or a sensor file")
        if not any(self.up):
            raise ValueError("up is the zero vector; it must point against gravity")
        images = [(self.sensor_of(n).name, self.name_of(n), touch.tactile_image) for n, touch in enumerate(self.touches)]
        images += [(self.sensor_of(n).name, f"{self.name_of(n)}: untouched", touch.untouched) for n, touch in enumerate(self.touches)]
        images += [] if self.sensor is None else [(self.sensor.name, "untouched", self.untouched)]
        firsts: dict[str, tuple[str, str]] = {}  # by sensor
        for sensor, name, image in images:
            if image is None:
                continue
            check_array(name, image, np.uint8, 3)
            first, size = firsts.setdefault(sensor, (name, size_text(image)))
            if size_text(image) != size:
                raise ValueError(f"{name} has {size_text(image)} pixels, {first} {size}; give photographs by one kind of sensor")
        return self

    @property
    def metres_per_unit(self) -> float:
        """Metres per unit of length."""
        return METRES[self.unit]

    @property
    def is_felt(self) -> bool:
        """Check whether there is input for networks with touch: a touch that is not stated to be none, or visible points in its place."""
        return any(touch.touched is not False for touch in self.touches) or (self.camera is not None and self.camera.depth_as_touch)

    @cached_property
    def shown_touches(self) -> NDArray[np.bool_]:
        """(T,): which touches count, as they are stated, or by their images' differences from the untouched one, if there is one."""
        return np.array([self._shows(number) for number in range(len(self.touches))], bool)

    def _shows(self, number: int) -> bool:
        touch, untouched = self.touches[number], self.untouched_of(number)
        if touch.touched != "auto":
            return touch.touched
        if touch.tactile_image is None:
            return touch.cloud is not None if touch.contact_pixels is None else bool(touch.contact_pixels.any())
        if untouched is None:
            return True
        change = touch.tactile_image.astype(np.float32) - untouched
        side = max(3, round(SMOOTHED * min(change.shape[:2])))
        changes = np.abs(uniform_filter(change, (side, side, 1))).max(axis=2)
        return bool(np.percentile(changes, 100 - CONTACT_SHARE) >= CHANGED)

    def sensor_of(self, number: int) -> Sensor:
        """Choose a touch's sensor."""
        sensor = self.touches[number].sensor or self.sensor
        assert sensor is not None  # a validator checks it
        return sensor

    def untouched_of(self, number: int) -> NDArray[np.uint8] | None:
        """Choose a touch's tactile image without contact: its own, or the observation's, which is of the observation's sensor."""
        touch = self.touches[number]
        return self.untouched if touch.untouched is None and touch.sensor is None else touch.untouched

    def name_of(self, number: int) -> str:
        """Name a touch for messages."""
        return self.touches[number].name or f"touches.{number}"

    def _metric(self, pose: Pose) -> NDArray[np.float64]:
        """Return a pose (4, 4), m."""
        scaled = pose.array.copy()
        scaled[:3, 3] *= self.metres_per_unit
        return scaled

    @cached_property
    def view(self) -> View | None:
        """The photograph with its projection."""
        if self.camera is None:
            return None
        k, pose = self.camera.intrinsics, self._metric(self.camera.pose)
        if self.camera.convention == "opengl":
            pose = pose @ np.diag([1.0, -1, -1, 1])
        intrinsic = np.array([[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1.0]])
        return View(self.camera, intrinsic @ np.column_stack([pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]]))

    @cached_property
    def sensor_poses(self) -> NDArray[np.float64]:
        """(T, 4, 4) sensor frames, m."""
        return np.array([self._metric(touch.pose) for touch in self.touches]).reshape(-1, 4, 4)

    @cached_property
    def gel_centres(self) -> NDArray[np.float64]:
        """(T, 3) middles of the gels' fronts, or of given points, m."""
        middles = [
            [0, 0, self.sensor_of(n).w] if touch.cloud is None else touch.cloud[:, :3].mean(axis=0) for n, touch in enumerate(self.touches)
        ]
        return transform_points(self.sensor_poses, np.reshape(middles, (-1, 1, 3)))[:, 0]

    @cached_property
    def gel_normals(self) -> NDArray[np.float64]:
        """(T, 3) directions out of the gels, by given points their mean normals."""
        outward = [[0, 0, 1.0] if touch.cloud is None else touch.cloud[:, 3:].mean(axis=0) for touch in self.touches]
        return np.asarray(np.einsum("tij,tj->ti", self.sensor_poses[:, :3, :3], np.reshape(outward, (-1, 3))))

    def __repr__(self) -> str:
        photograph = "a photograph" if self.camera else "no photograph"
        return f"RobotObservation({photograph}, {pluralise(len(self.touches), 'touch')}, {self.unit})"

    __str__ = __repr__


def read_observation(path: Path) -> tuple[RobotObservation | None, str, set[str]]:
    """Read an observation file with the files that it names, relative to its folder.

    Returns the observation of its valid entries, if they are one; a text that lists all invalid ones; and their names.
    """
    entries, context = read_yaml(path, "observation file"), {"folder": path.parent}
    try:
        return RobotObservation.model_validate(entries, context=context), "", set()
    except ValidationError as error:
        places = {item["loc"][:2] if item["loc"][:1] == ("touches",) else item["loc"][:1] for item in error.errors()}
        text = invalid_entries(error, entry_names(RobotObservation))
    invalid = {str(place[0]) for place in places if place}
    if not isinstance(entries, dict) or () in places:
        return None, text, invalid
    removed = {str(place[0]) for place in places if len(place) == 1}
    if "sensor" in removed:  # without it no touch is valid
        removed.add("touches")
    usable = {name: value for name, value in entries.items() if name not in removed}
    if isinstance(usable.get("touches"), list):
        numbered = [{"name": f"touches.{n}", **touch} if isinstance(touch, dict) else touch for n, touch in enumerate(usable["touches"])]
        usable["touches"] = [touch for n, touch in enumerate(numbered) if ("touches", n) not in places]
    try:
        return RobotObservation.model_validate(usable, context=context), text, invalid | removed
    except ValidationError:
        return None, text, invalid | removed
