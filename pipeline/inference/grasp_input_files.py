"""A grasp from a user's own files: an image, tactile images, and the poses of their sensors."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipeline.errors import StageError
from pipeline.kernels.touch.sensor import check_pose


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an image file: (rows, cols, 3) uint8 sRGB; transparency and more than 8 bits a colour are errors, grey becomes colour."""
    try:
        with Image.open(path) as image:
            if image.mode not in ("RGB", "L"):
                raise StageError(f"{path} has colours {image.mode}; save it as 8-bit RGB, without transparency")
            return np.asarray(image.convert("RGB"))
    except (OSError, UnidentifiedImageError) as error:
        raise StageError(f"{path} cannot be read as an image ({error})") from error


def read_readings(paths: Sequence[Path]) -> NDArray[np.uint8]:
    """Read tactile images, one file per sensor, all of one size: (T, rows, cols, 3) uint8."""
    readings = [read_image(path) for path in paths]
    for path, reading in zip(paths, readings, strict=True):
        if reading.shape != readings[0].shape:
            raise StageError(
                f"{path} has {reading.shape[:2]} pixels, {paths[0]} has {readings[0].shape[:2]}; all come from one kind of sensor"
            )
    return np.stack(readings) if readings else np.zeros((0, 0, 0, 3), np.uint8)


def read_poses(path: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    """Read sensor poses, and which sensors touched.

    Parameters
    ----------
    path
        A .npz file with the arrays `poses` and, optionally, `touched`; or a .json file with an object of the same names, or just the list
        of poses, each a list of four rows.

    Returns
    -------
    Poses (T, 4, 4), sensor frame to world frame, m; and flags (T,), None where the file does not say. The world frame is the one of the
    images' camera.

    Raises
    ------
    StageError
        The file cannot be read, has no poses, or a pose is no rigid motion.
    """
    try:
        with path.open("rb") as file:
            content: Any = np.load(file, allow_pickle=False) if path.suffix == ".npz" else json.load(file)
            if isinstance(content, list):
                content = {"poses": content}
            poses, touched = np.asarray(content["poses"], np.float64), content.get("touched")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StageError(f"{path} holds no sensor poses ({error}); see `vt-pipeline predict --help`") from error
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise StageError(f"{path}: poses have shape {poses.shape}; they must be (sensors, 4, 4)")
    for number, pose in enumerate(poses):
        try:
            check_pose(pose)
        except ValueError as error:
            raise StageError(f"{path}, pose {number}: {error}") from error
    if touched is None:
        return poses, None
    flags = np.asarray(touched)
    if flags.dtype != bool or flags.shape != poses.shape[:1]:
        raise StageError(f"{path}: touched is {flags.dtype} {flags.shape}; it must be true or false for each of the {len(poses)} poses")
    return poses, flags
