"""Read files of grasps made elsewhere: DexGraspBench's, DexGraspNet's, and arrays as `export --to grasps` writes them."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZIP_DEFLATED, ZIP_STORED

import numpy as np
from numpy.lib import format as npy
from scipy.spatial.transform import Rotation

from pipeline.console import abbreviate, visible
from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_file
from pipeline.formats.plain_pickle import read_plain_pickle
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import compose, invert_pose, pose_of

MAX_BYTES = 64 * 2**20  # largest size of a file, and of its arrays together: a grasp takes 1 kB
MAX_GRASPS = 100_000  # of a file
MAX_ROUNDING = 1e-3  # by which a rotation's columns, or a quaternion, may differ from unit length: files round to three digits
PHASES = ("pregrasp", "grasp", "squeeze")
ARRAYS = {"hand_pose", "joint_angles", "joint_names", "metres_per_unit", *PHASES}  # of an .npz file
TRANSLATION, ROTATION = ("WRJTx", "WRJTy", "WRJTz"), ("WRJRx", "WRJRy", "WRJRz")
"""DexGraspNet's names of the hand's position, m, and of its angles about fixed axes, rad."""
FORMATS = (
    "known are dictionaries with grasp_qpos, obj_scale and obj_pose (DexGraspBench), lists of dictionaries with qpos and scale "
    "(DexGraspNet), and .npz with hand_pose, joint_angles, joint_names and metres_per_unit"
)


class Stated(NamedTuple):
    """A grasp as a file states it."""

    scale: float  # m per unit of the object's file
    root: Array  # (4, 4) the file's hand to the object's own frame, whose axes are its file's; m
    joints: tuple[str, ...]  # names of its J joints; none where the file does not name them
    angles: Mapping[str, Array]  # (J,) rad (m), by the names of `PHASES`: `grasp`, and those others that the file has


@dataclass(frozen=True, eq=False)
class FileGrasp:
    """A grasp in a file: what it states, or why that cannot be used."""

    origin: str  # file and number, for messages
    stated: Stated | InvalidInput


def grasp_files(folder: Path, object_id: str) -> list[Path]:
    """List the files of an object's grasps: `ID.npz`, `ID.npy`, and those below the folder `ID`, in the order of their numbers.

    Files below the folder `A/B` are the object `A-B`'s, and `A`'s.
    """
    named = [folder / f"{object_id}{suffix}" for suffix in (".npz", ".npy")]
    files = [path for path in (*named, *(folder / object_id).rglob("*.np[yz]")) if path.is_file()]
    for dash in re.finditer("-", object_id):
        outer, inner = object_id[: dash.start()], object_id[dash.end() :]
        if outer and inner and not inner.startswith(".") and (folder / outer).is_dir():
            files += grasp_files(folder / outer, inner)
    return sorted(set(files), key=_numbered)


def _numbered(path: Path) -> list[Any]:
    """Split a path into text and numbers, which alternate, so that 10 follows 9."""
    return [int(part) if place % 2 else part for place, part in enumerate(re.split("([0-9]+)", path.as_posix()))]


def read_grasp_file(path: Path, folder: Path) -> Iterator[FileGrasp]:
    """Read the grasps of a file below a folder. Files with Python objects are read without running what they name."""
    name = visible(path.relative_to(folder).as_posix()).replace("\n", "\\n")
    try:
        readers = [*islice(_readers(read_file(path, MAX_BYTES, name)), MAX_GRASPS + 1)]
        if len(readers) > MAX_GRASPS:
            raise InvalidInput(f"it has more than {MAX_GRASPS} grasps; split it into several files")
    except InvalidInput as error:
        yield FileGrasp(name, error)
        return
    for number, read in enumerate(readers):
        try:
            stated: Stated | InvalidInput = read()
        except InvalidInput as error:
            stated = error
        yield FileGrasp(name if len(readers) == 1 else f"{name}, grasp {number}", stated)


def _readers(content: bytes) -> Iterator[Callable[[], Stated]]:
    """Yield what reads each grasp of a file."""
    if content.startswith(b"PK"):
        arrays = _arrays(content)
        yield from (partial(_array_grasp, arrays, row) for row in range(_count(arrays)))
        return
    array = _pickled(content)
    for entry in array.ravel() if isinstance(array, np.ndarray) else [array]:
        if not isinstance(entry, dict) or not entry.keys() & {"qpos", "grasp_qpos"}:
            entries = f"the entries {abbreviate([ascii(key[:40]) for key in entry])}" if isinstance(entry, dict) else "no dictionary"
            raise InvalidInput(f"it has {entries}; {FORMATS}")
        if "qpos" in entry:
            yield partial(_dexgraspnet, entry)
        elif np.ndim(qpos := _array(entry, "grasp_qpos")) == 2:
            yield from (partial(_dexgraspbench, entry, row) for row in range(len(qpos)))
        else:
            yield partial(_dexgraspbench, entry, ...)


def _arrays(content: bytes) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file that grasps need."""
    part = "it"
    try:
        with np.load(BytesIO(content), allow_pickle=False) as archive:
            members, arrays = archive.zip.infolist(), dict[str, np.ndarray]()
            if any(member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) for member in members):  # zipfile expands others at once
                raise InvalidInput("it is compressed in another way than NumPy does; write it again with numpy.savez_compressed")
            if sum(member.file_size for member in members) > MAX_BYTES:  # zipfile reads no more than that
                raise InvalidInput(f"its arrays have more than {MAX_BYTES} bytes; split it into several files")
            for part in sorted(ARRAYS.intersection(archive.files)):
                arrays[part] = archive[part]
                if arrays[part].dtype.itemsize == 0:  # a short file may state any number of empty names
                    raise InvalidInput(f"{part} has type {arrays[part].dtype}, whose values are empty; write numbers, and names as text")
    except InvalidInput:
        raise
    except Exception as error:  # zipfile and NumPy raise whatever they trip over
        raise InvalidInput(f"{part} is no array that can be read ({error}); write numbers, and names as text, with numpy.savez") from error
    return arrays


def _pickled(content: bytes) -> Any:
    """Read the Python objects of a .npy file; None where it has numbers."""
    stream = BytesIO(content)
    try:
        header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[npy.read_magic(stream)]
        *_, dtype = header(stream)
    except Exception as error:  # NumPy raises whatever its parsing of a header trips over
        raise InvalidInput(f"it is no array that can be read ({error}); write .npy with numpy.save, .npz with numpy.savez") from error
    return read_plain_pickle(stream.read()) if dtype.hasobject else None


def _array_grasp(arrays: Mapping[str, Any], row: int) -> Stated:
    """Read a grasp of an .npz file: positions are in the unit of the object's file."""
    scale, count, joints = _scale(arrays, "metres_per_unit"), _count(arrays), _joint_names(arrays)
    renamed = {"grasp": "grasp" if "grasp" in arrays else "joint_angles"}
    names = {phase: renamed.get(phase, phase) for phase in PHASES if phase == "grasp" or phase in arrays}
    angles = {phase: _numbers(arrays, name, (count, len(joints)), row) for phase, name in names.items()}
    pose = _numbers(arrays, "hand_pose", (count, 4, 4), row)
    if not np.allclose(pose[3], (0, 0, 0, 1)):
        raise InvalidInput(f"hand_pose has {pose[3]} as its last row; it must be 0, 0, 0, 1")
    return Stated(scale, pose_of(_matrix(pose[:3, :3]), scale * pose[:3, 3]), joints, angles)


def _dexgraspbench(entry: Mapping[str, Any], row: Any) -> Stated:
    """Read a grasp of DexGraspBench, BODex or Dexonomy: position, m, and quaternion of the hand, real part first, then its joints."""
    names = {phase: f"{phase}_qpos" for phase in PHASES if f"{phase}_qpos" in entry}
    shape = _array(entry, "grasp_qpos").shape
    if len(shape) not in (1, 2) or shape[-1] <= 7:
        raise InvalidInput(f"grasp_qpos has shape {shape}; it must have 7 numbers of the root and those of all joints, or rows of these")
    qpos = {phase: _numbers(entry, name, shape, row) for phase, name in names.items()}
    if "scene_path" in entry and not {"obj_scale", "obj_pose"} <= entry.keys():
        raise InvalidInput("it names a scene instead of obj_scale and obj_pose; add both, as DexGraspBench's task=format does")
    root, scene = (pose_of(_quaternion(values[3:7]), values[:3]) for values in (qpos["grasp"], _numbers(entry, "obj_pose", (7,))))
    joints = _joint_names(entry) if "joint_names" in entry else ()
    if joints and len(joints) != len(qpos["grasp"]) - 7:
        raise InvalidInput(f"joint_names has {len(joints)} names, the joints in grasp_qpos are {len(qpos['grasp']) - 7}")
    angles = {phase: values[7:] for phase, values in qpos.items()}
    return Stated(_scale(entry, "obj_scale", row), compose(invert_pose(scene), root), joints, angles)


def _dexgraspnet(entry: Mapping[str, Any]) -> Stated:
    """Read a grasp of DexGraspNet: by name, m and rad, in the frame of the object's file."""
    qpos = entry["qpos"]
    if not isinstance(qpos, dict):
        raise InvalidInput(f"qpos is no dictionary; {FORMATS}")
    joints = tuple(name for name in qpos if name not in (*TRANSLATION, *ROTATION))
    position, turn, angles = (np.array([_number(qpos, name) for name in names]) for names in (TRANSLATION, ROTATION, joints))
    return Stated(_scale(entry, "scale"), pose_of(Rotation.from_euler("xyz", turn).as_matrix(), position), joints, {"grasp": angles})


def _array(entry: Mapping[str, Any], name: str) -> np.ndarray:
    if not isinstance(value := entry.get(name), np.ndarray):
        raise InvalidInput(f"it has no array {name}; {FORMATS}")
    return value


def _count(arrays: Mapping[str, Any]) -> int:
    """Count the grasps of an .npz file."""
    shape = _array(arrays, "hand_pose").shape
    if len(shape) != 3 or shape[1:] != (4, 4):
        raise InvalidInput(f"hand_pose has shape {shape}; it must be (G, 4, 4), a matrix per grasp, also of one grasp")
    return int(shape[0])


def _joint_names(entry: Mapping[str, Any]) -> tuple[str, ...]:
    names = _array(entry, "joint_names")
    if names.dtype.kind != "U" or names.ndim != 1:
        raise InvalidInput(f"joint_names has type {names.dtype} and shape {names.shape}; it must be a list of names")
    return tuple(names.tolist())


def _numbers(entry: Mapping[str, Any], name: str, shape: tuple[int, ...], row: Any = ...) -> Array:
    """Read an array of numbers, or a row of it."""
    array = _array(entry, name)
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise InvalidInput(f"{name} has shape {array.shape} and type {array.dtype}; it must be numbers of shape {shape}")
    values: Array = array[row].astype(np.float64)
    if not np.isfinite(values).all():
        raise InvalidInput(f"{name} has a value that is not finite; correct it, or remove the grasp")
    return values


def _number(entry: Mapping[str, Any], name: str) -> float:
    value: Any = entry.get(name)
    if isinstance(value, np.ndarray | np.generic) and value.size == 1:
        value = value.item()
    if not isinstance(value, int | float) or not abs(value) < 1e6:
        raise InvalidInput(f"it has no number {name} between -1e6 and 1e6; {FORMATS}")
    return float(value)


def _scale(entry: Mapping[str, Any], name: str, row: Any = ...) -> float:
    value = entry.get(name)
    if isinstance(value, np.ndarray) and value.size > 1 and row is not ...:
        if row >= len(value):
            raise InvalidInput(f"{name} has {len(value)} values; it must have one, or one per grasp")
        entry = {name: value[row]}
    scale = _number(entry, name)
    if scale <= 0:
        raise InvalidInput(f"{name} is {scale:g}; it must be metres per unit of the object's file, above 0")
    return scale


def _matrix(matrix: Array) -> Array:
    """Return the rotation that a file rounded."""
    if np.abs(matrix.T @ matrix - np.eye(3)).max() > MAX_ROUNDING or np.linalg.det(matrix) < 0:
        raise InvalidInput("hand_pose is no rotation and shift: the columns of its first three rows must be perpendicular, of length 1")
    return np.asarray(Rotation.from_matrix(matrix).as_matrix())


def _quaternion(values: Array) -> Array:
    if abs(float(np.linalg.norm(values)) - 1) > MAX_ROUNDING:
        raise InvalidInput(f"{values.round(4).tolist()} is no rotation: a quaternion, real part first, must have length 1")
    return np.asarray(Rotation.from_quat(values, scalar_first=True).as_matrix())
