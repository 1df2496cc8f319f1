"""Entries of observation files: images and sensors as files or arrays, and poses in the ways that robots' programs write them."""

from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, WithJsonSchema, model_validator
from scipy.spatial.transform import Rotation

from pipeline.entries import Entries
from pipeline.formats.description_file import shipped_files
from pipeline.formats.image_file import read_depth, read_gel_depth, read_image, read_mask
from pipeline.formats.ply import read_points
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.transforms import rotation_from_euler
from pipeline.kernels.touch.sensor import Sensor

ROTATION_TOLERANCE = 1e-3  # deviation from orthonormal of a rotation that is rounded to the nearest one: files have few digits
QUATERNION_TOLERANCE = 1e-2  # deviation of a quaternion's length from 1

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]


class FileEntries(Entries):
    """Entries of an observation file."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        for name in type(self).model_fields:
            if (value := getattr(self, name)) is not None:
                yield name, f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else value

    def changed(self, **changes: Any) -> Self:
        """Return a validated copy with other values; cached properties are computed again."""
        return type(self).model_validate({name: getattr(self, name) for name in type(self).model_fields} | changes)


def _from_file(reader: Callable[[Path, str | Path], Any], kind: type, expected: str) -> BeforeValidator:
    """Read a file that is named relative to the observation file; take what it would give as it is."""

    def validate(value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, str | Path):
            return reader((info.context or {}).get("folder", Path()), value)
        if isinstance(value, kind):
            return value
        raise ValueError(f"it must be {expected}")

    return BeforeValidator(validate)


def _array_from(reader: Callable[[Path], Any], array_type: str) -> BeforeValidator:
    return _from_file(lambda folder, name: reader(folder / name), np.ndarray, f"the name of a file, or an array of {array_type}")


def _read_sensor(folder: Path, name: str | Path) -> Sensor:
    is_name = str(name) in shipped_files("sensor") or not (Path(name).suffix or (folder / name).exists())
    return load_sensor(name if is_name else folder / name)


_FILE = WithJsonSchema({"type": "file"})
Image = Annotated[NDArray[np.uint8], _array_from(read_image, "uint8 (rows, cols, 3)"), _FILE]
Mask = Annotated[NDArray[np.bool_], _array_from(read_mask, "bool (rows, cols)"), _FILE]
Depth = Annotated[NDArray[Any], _array_from(read_depth, "uint16 or float32 (rows, cols)"), _FILE]
GelDepth = Annotated[NDArray[np.float64], _array_from(read_gel_depth, "floats (rows, cols), m"), _FILE]
Points = Annotated[NDArray[np.float64], _array_from(read_points, "floats (N, 6), m"), _FILE]
_SENSOR = _from_file(_read_sensor, Sensor, "the name of a built-in sensor, or of a sensor file")
SensorName = Annotated[Sensor, _SENSOR, WithJsonSchema({"type": "name"})]


def check_array(name: str, array: Any, dtype: Any, dims: int) -> None:
    """Raise a `ValueError` if an array has another type, another number of dimensions, not three colours, or no element."""
    if array.dtype != dtype or array.ndim != dims or (dims == 3 and array.shape[2] != 3) or not array.size:
        raise ValueError(f"{name} is {array.dtype} {array.shape}; it must be {np.dtype(dtype)} (rows, cols{', 3' * (dims == 3)})")


def size_text(array: NDArray[Any]) -> str:
    """Write columns x rows, for messages."""
    return f"{array.shape[1]} x {array.shape[0]}"


class Pose(FileEntries):
    """A frame in the file's frame: `position`, and `quaternion` or `rpy`; or `matrix`, which may be given in place of the mapping."""

    position: Vector | None = Field(default=None, description="of the frame's origin")
    quaternion: Row | None = Field(default=None, description="[x, y, z, w], as ROS writes it")
    rpy: Vector | None = Field(default=None, description="roll, pitch, yaw, rad, about the fixed x, y and z axes, as in a URDF")
    matrix: tuple[Row, Row, Row, Row] | None = Field(default=None, description="4 × 4, four rows; the last is 0 0 0 1")

    @model_validator(mode="before")
    @classmethod
    def _bare_matrix(cls, value: Any) -> Any:
        if isinstance(value, np.ndarray | list | tuple):
            return {"matrix": value.tolist() if isinstance(value, np.ndarray) else value}
        return value

    @model_validator(mode="after")
    def _is_rigid(self) -> Self:
        rotations = [name for name in ("matrix", "quaternion", "rpy") if getattr(self, name) is not None]
        if len(rotations) != 1 or (self.position is None) != (rotations == ["matrix"]):
            raise ValueError("a pose has a matrix, or a position and either a quaternion or rpy")
        if self.rpy is not None and max(map(abs, self.rpy)) > 2 * np.pi:
            raise ValueError(f"rpy is {list(self.rpy)}: radians are within ± 2 π; are these degrees?")
        if self.quaternion is not None and abs(float(np.linalg.norm(self.quaternion)) - 1) > QUATERNION_TOLERANCE:
            raise ValueError(f"the quaternion has the length {np.linalg.norm(self.quaternion):.4g}; it must be 1, as [x, y, z, w]")
        if self.matrix is not None:
            matrix = np.array(self.matrix)
            if (matrix[3] != (0, 0, 0, 1)).any():
                raise ValueError(f"the last row is {matrix[3].tolist()}; it must be 0 0 0 1 (is the matrix transposed?)")
            with np.errstate(over="ignore", invalid="ignore"):
                deviation = np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max()
            if not deviation <= ROTATION_TOLERANCE:
                raise ValueError(f"it is not rigid: its axes are {deviation:.3g} from orthonormal (at most {ROTATION_TOLERANCE:g})")
            if np.linalg.det(matrix[:3, :3]) < 0:
                raise ValueError("it is not rigid: it mirrors (its axes are left-handed)")
        return self

    @cached_property
    def array(self) -> NDArray[np.float64]:
        """(4, 4) in the file's unit, with the nearest rotation."""
        pose = np.eye(4)
        if self.matrix is not None:
            left, _, right = np.linalg.svd(np.array(self.matrix)[:3, :3])
            pose[:3, :3], pose[:3, 3] = left @ right, np.array(self.matrix)[:3, 3]
            return pose
        rotation = rotation_from_euler(self.rpy) if self.rpy is not None else Rotation.from_quat(self.quaternion).as_matrix()
        pose[:3, :3], pose[:3, 3] = rotation, self.position
        return pose
