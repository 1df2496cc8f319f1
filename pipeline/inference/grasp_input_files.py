"""Read a grasp from a user's files: tactile images, and the poses of their sensors."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_file
from pipeline.formats.image_file import read_image
from pipeline.kernels.touch.sensor import check_pose

FARTHEST = 10.0
"""m, largest coordinate of a sensor in the world."""
MAX_BYTES = 2**20
"""Size of a file of poses, and of each array in it; enough for 8000 poses."""


def read_tactile_images(paths: Sequence[Path]) -> NDArray[np.uint8]:
    """Read tactile images, one file per sensor, all of one size: (T, rows, cols, 3) uint8."""
    tactile_images = [read_image(path) for path in paths]
    for path, image in zip(paths, tactile_images, strict=True):
        if image.shape != tactile_images[0].shape:
            raise InvalidInput(
                f"{path} has {image.shape[:2]} pixels, {paths[0]} has {tactile_images[0].shape[:2]}; give images of one kind of sensor"
            )
    return np.stack(tactile_images) if tactile_images else np.zeros((0, 0, 0, 3), np.uint8)


def read_poses(path: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    """Read sensor poses, and which sensors touched.

    Parameters
    ----------
    path
        A .npz file with the arrays `poses` and, optionally, `touched`; or a .json file with an object of the same names, or just the list
        of poses, each a list of four rows.

    Returns
    -------
    Poses (T, 4, 4), sensor frame to world frame of the images' camera, m; and flags (T,), None if the file has none.

    Raises
    ------
    InvalidInput
        The file cannot be read, has no poses, or a pose is not a rigid motion, or is farther than `FARTHEST`, perhaps in millimetres.
    """
    content = read_file(path, MAX_BYTES)
    try:
        arrays = _npz_arrays(content) if path.suffix == ".npz" else _json_arrays(content)
    except Exception as error:  # the readers of zip files and of numpy's headers raise whatever their parsing trips over
        raise InvalidInput(f"{path} holds no sensor poses ({error}); see `vt-pipeline predict --help`") from error
    poses, touched = arrays["poses"], arrays.get("touched")
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or poses.dtype.kind not in "iuf":
        raise InvalidInput(f"{path}: poses are {poses.dtype} {poses.shape}; they must be numbers, (sensors, 4, 4)")
    for number, pose in enumerate(poses):
        try:
            check_pose(pose)
        except InvalidInput as error:
            raise InvalidInput(f"{path}, pose {number}: {error}") from error
        if (away := np.abs(pose[:3, 3]).max()) > FARTHEST:
            raise InvalidInput(f"{path}, pose {number} is {away:g} m away; poses are in metres, of the world of the images' camera")
    if touched is not None and (touched.dtype != bool or touched.shape != poses.shape[:1]):
        raise InvalidInput(
            f"{path}: touched is {touched.dtype} {touched.shape}; it must be true or false for each of the {len(poses)} poses"
        )
    return poses.astype(np.float64), touched


def _json_arrays(content: bytes) -> dict[str, np.ndarray]:
    entries: Any = json.loads(content)
    if isinstance(entries, list):
        entries = {"poses": entries}
    if not isinstance(entries, dict) or entries.get("poses") is None:
        raise ValueError("it has no list of poses")
    return {name: np.asarray(entries[name]) for name in ("poses", "touched") if entries.get(name) is not None}


def _npz_arrays(content: bytes) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
        return {name: _npy_array(archive, members[name]) for name in ("poses", "touched") if name == "poses" or name in members}


def _npy_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """Read an array; compare its header with its size before allocating memory."""
    if member.file_size > MAX_BYTES or member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename} has {member.file_size} bytes, {MAX_BYTES} are the most, stored or deflated")
    file = io.BytesIO(archive.read(member))
    if (version := np.lib.format.read_magic(file)) != (1, 0):
        raise ValueError(f"{member.filename} is of numpy's format {version}; save it with numpy.savez")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
    values = file.read()
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(values):
        raise ValueError(f"{member.filename} claims {dtype} {shape}, and has {len(values)} bytes of values")
    return np.frombuffer(values, dtype).reshape(shape, order="F" if fortran else "C")
