"""The description of a tactile sensor: gel and optics; the positions of its pixels, and its pose.

The sensor frame has its origin at the centre of the sensor plane, the base of the gel; +x runs along image columns, +y along image
rows, +z is the outward normal. Lengths are metres.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from PIL import Image
from pydantic import ConfigDict, Field, Strict, model_validator
from pydantic.json_schema import SkipJsonSchema

from pipeline.entries import Entries
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Mask, check_shape
from pipeline.kernels.touch.markers import MarkerGrid

MM = 1e3  # millimetres per metre
MAX_FRICTION = 1000.0  # coefficient that holds whatever is pressed
MAX_PIXELS_PER_SIDE = 4096  # rows and columns of an image: more than any camera of a sensor has

Length = Annotated[float, Field(ge=1e-6, le=10)]
POSE_TOLERANCE = 1e-6  # largest deviation of a pose's axes from orthonormal: the error of float32 arithmetic
Lateral = Annotated[float, Field(ge=-1000, le=1000)]
Position = tuple[Lateral, Lateral, Annotated[float, Field(gt=0, le=1000)]]
Level = Annotated[float, Field(ge=-1e7, le=1e7)]
Levels = tuple[Level, Level, Level]
Box = tuple[float, float, float, float]  # least x and y, greatest x and y, m
Place = Annotated[float, Field(ge=-10, le=10)]
Friction = Annotated[float, Field(ge=0, le=MAX_FRICTION)]

POSITION_TERMS = {(degree + 1) * (degree + 2) // 2: degree for degree in range(7)}  # degree in x and y by number of terms
SLOPE_TERMS = {count - 1: degree for count, degree in POSITION_TERMS.items() if degree}  # in a normal, without a constant


class Lights(Entries):
    """Positions P of the three lamps of equation 5, in sensor widths, along y too, from the corner of pixel (0, 0)."""

    red: Annotated[Position, Field(description="x along columns, y along rows, z out of the gel")]
    green: Annotated[Position, Field(description="as red")]
    blue: Annotated[Position, Field(description="as red")]


class Shadow(Entries):
    """The shadow of one lamp behind a bump of the gel."""

    direction: Annotated[float, Field(ge=-360, le=360, description="towards the lamp, degrees from +x to +y")]
    slope: Annotated[float, Field(gt=0, le=100, description="height over length of the lamp's rays")]
    gain: Annotated[Levels, Field(description="levels of red, green, blue per mm that a point lies in the shade")]


class Calibration(Entries):
    """A model of colours that was fitted to photographs: a polynomial of the gel's normal, whose coefficients depend on the position."""

    coefficients: Annotated[
        tuple[tuple[tuple[Level, ...], ...], ...],
        Field(description="levels by colour, term of the normal (nx, ny, nx², nx ny, …), term of the position (1, x, y, x², x y, …)"),
    ]
    depth: Annotated[
        tuple[tuple[Level, ...], ...] | None,
        Field(
            exclude_if=lambda depth: depth is None,
            description="levels per mm that the gel is pressed in, by colour and term of the position: what is nearer to the camera is lit "
            "differently; by default none",
        ),
    ] = None
    background: Annotated[
        tuple[Levels, ...] | str,
        Field(description="the untouched image: levels by term of the position, or a PNG beside the sensor file"),
    ]
    shadows: Annotated[tuple[Shadow, ...], Field(description="that lamps cast behind bumps of the gel")] = ()
    steepest: Annotated[
        float, Field(gt=0, le=1, description="sine of the steepest slope that was fitted: steeper ones get its colours, none are guessed")
    ] = 1.0
    deepest: Annotated[
        float,
        Field(
            gt=0, le=10, description="depth of the deepest fitted contact, m: deeper ones have its light and shadows; by default no limit"
        ),
    ] = 10.0
    within: Annotated[
        tuple[Place, Place, Place, Place] | None,
        Field(description="part of the gel in which contacts were fitted, m: least x and y, greatest x and y; beyond it, as at its rim"),
    ] = None

    @model_validator(mode="after")
    def _are_polynomials(self) -> "Calibration":
        slopes, positions = {len(color) for color in self.coefficients}, {len(term) for color in self.coefficients for term in color}
        fits = len(slopes) == len(positions) == 1 and slopes <= SLOPE_TERMS.keys() and positions <= POSITION_TERMS.keys()
        if len(self.coefficients) != 3 or not fits:
            have = f"{len(self.coefficients)} colours with {sorted(slopes)} terms of the normal and {sorted(positions)} of the position"
            allowed = f"3, each with one of {list(SLOPE_TERMS)}, each with one of {list(POSITION_TERMS)}"
            raise ValueError(f"coefficients has {have}; there must be {allowed}")
        if self.depth is not None and [len(color) for color in self.depth] != 3 * list(positions):
            have = f"{[len(color) for color in self.depth]} terms of the position by colour"
            raise ValueError(f"depth has {have}; there must be 3 colours, each with as many as coefficients have, {positions.pop()}")
        if not isinstance(self.background, str) and len(self.background) not in POSITION_TERMS:
            raise ValueError(f"background has {len(self.background)} terms of the position; there must be one of {list(POSITION_TERMS)}")
        if self.within is not None and not (self.within[0] < self.within[2] and self.within[1] < self.within[3]):
            raise ValueError(f"within is {list(self.within)}; it must be the least x and y, then the greatest x and y, m")
        return self


class Surface(Entries):
    """The shape of a gel that is not flat: a bulge of some radius, or a map of heights."""

    radius: Annotated[Length | None, Field(description="of a sphere or cylinder whose highest point, in the middle, is w, m")] = None
    along: Annotated[
        Literal["both", "x", "y"],
        Field(
            description="the way in which a bulge falls off: both, a sphere; x, a cylinder that is lower at its first and last column (its "
            "axis is y); y, one that is lower at its first and last row"
        ),
    ] = "both"
    heights: Annotated[
        tuple[tuple[Length, ...], ...] | None,
        Field(description="above the sensor plane on a grid from rim to rim, rows along +y, linear in between, m"),
    ] = None

    @model_validator(mode="after")
    def _has_one_form(self) -> "Surface":
        if (self.radius is None) == (self.heights is None):
            raise ValueError("give either a radius or heights")
        if self.radius is None and self.along != "both":
            raise ValueError(f"along: {self.along} is how a bulge of some radius falls off; omit it for heights")
        if self.heights is not None and (len(self.heights) < 2 or len(self.heights[0]) < 2 or len({len(row) for row in self.heights}) > 1):
            raise ValueError("heights must be a grid of 2 x 2 or more, with as many in each row")
        return self


class Gel(Entries):
    """An elastic gel: a layer of rubber, bonded to a rigid plate."""

    modulus: Annotated[float, Field(gt=0, le=1e12, description="Young's modulus, Pa; a gel's is some 1e5")]
    poisson: Annotated[float, Field(ge=0, le=0.5, description="Poisson's ratio; rubber's is nearly 0.5")] = 0.48
    thickness: Annotated[Length | None, Field(description="of the elastic layer, m; by default w")] = None
    friction: Annotated[
        Friction | None, Field(exclude_if=lambda friction: friction is None, description="coefficient of friction with what slides on it")
    ] = None


class Sensor(Entries):
    """A gel on a rectangular sensor plane, seen by a camera below it."""

    model_config = ConfigDict(serialize_by_alias=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+$", max_length=120, description="recorded in datasets")]
    width: Annotated[Length, Field(description="side of the sensor plane along +x, m")]
    given_height: Annotated[Length | None, Field(alias="height", description="side along +y, m; by default the width")] = None
    rows: Annotated[int, Field(ge=2, le=MAX_PIXELS_PER_SIDE, description="pixels along +y; a gradient needs two")]
    cols: Annotated[int, Field(ge=2, le=MAX_PIXELS_PER_SIDE, description="pixels along +x; a gradient needs two")]
    w: Annotated[Length, Field(description="thickness of the gel, m (equation 1); of a curved one in the middle")]
    range: Annotated[Length, Field(description="greatest depth at which a surface is seen, m")]
    surface: Annotated[
        Surface | None,
        Field(description="shape of the gel; by default flat. Rays stay parallel, and a touch is measured by the depth below it"),
    ] = None
    membrane: Annotated[float, Field(ge=0, le=1, description="how far the gel is drawn in around a contact, m; 0 for not at all")] = 0.0
    gel: Annotated[
        Gel | None,
        Field(exclude_if=lambda gel: gel is None, description="an elastic gel, which gives pressure and force; no membrane then"),
    ] = None
    markers: Annotated[
        MarkerGrid | None, Field(exclude_if=lambda markers: markers is None, description="dots printed on the elastic gel; by default none")
    ] = None
    noise: Annotated[
        Literal["none"] | Annotated[float, Field(gt=0, le=128)], Field(description="standard deviation of pixel noise, levels of 255")
    ]
    diffuse: Annotated[float, Field(gt=0, le=1e6, description="diffuse reflection constant, lambda of equation 2")] = 1.0
    lights: Annotated[Lights | None, Field(description="lamps of equations 2 to 5; a sensor has these or is calibrated")] = None
    calibrated: Annotated[Calibration | None, Field(description="colours fitted to photographs")] = None
    photograph: Annotated[
        SkipJsonSchema[Annotated[bytes, Strict()] | None],
        Field(exclude=True, repr=False, description="the background's pixels, rows * cols * 3 bytes, which the loader reads"),
    ] = None

    @model_validator(mode="after")
    def _is_consistent(self) -> "Sensor":
        if (self.lights is None) == (self.calibrated is None):
            raise ValueError("give either lights (equations 2 to 5) or calibrated (coefficients fitted to photographs)")
        if self.calibrated is not None and self.diffuse != 1:
            raise ValueError(f"diffuse {self.diffuse} belongs to lights (equation 2); omit it for a calibrated sensor")
        within = None if self.calibrated is None else self.calibrated.within
        if within is not None and (np.abs(within) > np.array([self.width, self.height] * 2)).any():  # such as mm
            rim = f"the gel, whose rim is {self.width / 2:g} m and {self.height / 2:g} m from its middle"
            raise ValueError(f"calibrated.within {list(within)} lies far beyond {rim}; state it in metres from there")
        if self.gel is not None and self.membrane > 0:
            raise ValueError(f"a membrane of {self.membrane} m and an elastic gel exclude each other: remove one")
        if self.markers is not None:
            self.markers.check_spacing(self.width, self.height)
            if self.gel is None:
                raise ValueError("markers move with an elastic gel, and there is none: give `gel: {modulus: …}`, or remove them")
        if self.surface is not None and self.surface.radius is not None:
            reach = {"both": np.hypot(self.width, self.height), "x": self.width, "y": self.height}[self.surface.along] / 2
            radius = self.surface.radius
            if reach >= radius or radius - np.sqrt(radius**2 - reach**2) >= self.w:
                raise ValueError(f"a gel of radius {radius} m and thickness w {self.w} m ends before its rim, {reach:.4g} m away")
        heights = self.surface.heights if self.surface is not None else None
        if self.range < (top := max(self.w, *(max(row) for row in heights or [[0.0]]))):
            raise ValueError(f"range {self.range} m ends inside the gel, which is {top} m high; make it larger")
        return self

    def __repr__(self) -> str:
        return f"Sensor({self.name}, {self.shape} pixels, {1e3 * self.width:.3g} mm wide)"

    __str__ = __repr__

    @property
    def height(self) -> float:
        """Side of the sensor plane along +y, m."""
        return self.width if self.given_height is None else self.given_height

    @property
    def layer_thickness(self) -> float:
        """Thickness of the elastic layer, m: w, unless the gel states its own."""
        return self.w if self.gel is None or self.gel.thickness is None else self.gel.thickness

    @property
    def pitch(self) -> tuple[float, float]:
        """Size of a pixel along y and x, m."""
        return self.height / self.rows, self.width / self.cols

    @property
    def aspect(self) -> float:
        """Height over width."""
        return self.height / self.width

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of an image."""
        return self.rows, self.cols


def sensor_differences(one: Sensor, other: Sensor, *, but_for: Mapping[str, Any]) -> list[str]:
    """Name the entries in which two sensors differ, defaults filled in; `but_for` names those that may, as pydantic's `exclude` does."""
    entries = []
    for sensor in (one, other):
        gel = sensor.gel and sensor.gel.model_copy(update={"thickness": sensor.layer_thickness})
        entries.append(sensor.model_copy(update={"given_height": sensor.height, "gel": gel}).model_dump(exclude=dict(but_for)))
    ours, theirs = entries
    return sorted(name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))


def pixel_centres(sensor: Sensor) -> tuple[Array, Array]:
    """Compute the positions x (cols,) and y (rows,) of the pixel centres on the sensor plane, sensor frame, m."""
    x = ((np.arange(sensor.cols) + 0.5) / sensor.cols - 0.5) * sensor.width
    y = ((np.arange(sensor.rows) + 0.5) / sensor.rows - 0.5) * sensor.height
    return x, y


def masked_points(depth: np.ndarray, mask: Mask, sensor: Sensor) -> Array:  # (n, 3) sensor frame, m, in row-major order
    """Compute the points that the n pixels of a mask (rows, cols) see at depth D (rows, cols), m."""
    row, col = np.nonzero(mask)
    x, y = pixel_centres(sensor)
    return np.stack([x[col], y[row], depth[row, col]], axis=1, dtype=np.float64)


def check_pose(pose: np.ndarray, name: str = "sensor pose") -> Array:
    """Check that a pose (4, 4), sensor frame to world frame, m, is a rigid motion: else it is `InvalidInput`."""
    pose = np.asarray(pose, np.float64)
    check_shape(name, pose, 4, 4)
    rotation = pose[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
        faults = {
            "it holds numbers that are not finite": not np.isfinite(pose).all(),
            "its last row is not 0 0 0 1; is it transposed?": (pose[3] != (0, 0, 0, 1)).any(),
            f"its axes are {deviation:.3g} from orthonormal, at most {POSE_TOLERANCE:g}; scale the mesh": deviation > POSE_TOLERANCE,
            "its axes are left-handed; turn one around": np.linalg.det(rotation) < 0,
        }
    for fault in [fault for fault, present in faults.items() if present][:1]:
        raise InvalidInput(f"{name} is not a rigid motion: {fault}:\n{pose}")
    return pose


def sensor_to_world(pose: Array, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Array:  # (..., 3) world, m
    """Transform points of coordinates (...), sensor frame, m, by a pose (4, 4): element by element, with the same bits in any array."""
    return np.stack([row[3] + (row[0] * x + row[1] * y + row[2] * z) for row in pose[:3]], axis=-1)


def resample(sensor: Sensor, rows: int, cols: int) -> Sensor:
    """Change a sensor's number of pixels; gel, optics, noise per pixel and the view of its background, a resized photograph, stay."""
    if not all(isinstance(count, int | np.integer) and 2 <= count <= MAX_PIXELS_PER_SIDE for count in (rows, cols)):
        raise InvalidInput(f"a sensor has from 2 to {MAX_PIXELS_PER_SIDE} rows and columns of pixels; these are {rows} x {cols}")
    if (rows, cols) == sensor.shape:
        return sensor
    changes: dict[str, Any] = {"rows": int(rows), "cols": int(cols)}
    if sensor.photograph is not None:
        photograph = Image.frombytes("RGB", (sensor.cols, sensor.rows), sensor.photograph)
        changes["photograph"] = photograph.resize((cols, rows), Image.Resampling.BILINEAR).tobytes()  # its support widens where it averages
    return sensor.model_copy(update=changes)


def resample_longer_side(sensor: Sensor, pixels: int) -> Sensor:
    """Give a sensor square pixels, `pixels` of them along its longer side; otherwise as `resample`."""
    pitch = max(sensor.width, sensor.height) / pixels
    return resample(sensor, *(max(2, round(side / pitch)) for side in (sensor.height, sensor.width)))
