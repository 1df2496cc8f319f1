"""Touches: the measurements of a sensor pressed onto an object."""

import mmap
import multiprocessing
import operator
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.transforms import invert_pose
from pipeline.kernels.touch.depth_maps import in_gel, normal_force, press_gel, touch_success
from pipeline.kernels.touch.elastic_contact import PressedGel
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor, check_pose, masked_points, sensor_to_world
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from vt_pipeline.objects import Source, TouchObject, as_object

MIN_TOUCHES_PER_PROCESS = 32  # least number of touches for which a process is started


@dataclass(frozen=True, eq=False)
class Touch:
    """Hold the measurement of one sensor.

    Attributes
    ----------
    sensor, pose
        The sensor, and its frame in the world, (4, 4) float64, m.
    depth
        (rows, cols) float32, m: distance D from the sensor plane along its normal; +inf without a surface within range.
    image
        (rows, cols, 3) uint8, the tactile image.
    """

    sensor: Sensor
    pose: NDArray[np.float64]
    depth: NDArray[np.float32]
    image: NDArray[np.uint8]

    def __repr__(self) -> str:
        return f"Touch({self.sensor.name}, {1e6 * self.contact_area:.3g} mm² of contact)"

    @cached_property
    def contact(self) -> NDArray[np.bool_]:
        """(rows, cols): where the object is in the gel; where the sensor's gel is elastic, where it presses."""
        return in_gel(self.depth, self.sensor) if self.sensor.gel is None else self.gel.contact

    @cached_property
    def gel(self) -> PressedGel:
        """The gel's own surface, `indentation`, where the object touches it, `contact`, and an elastic gel's `pressure`."""
        return press_gel(self.depth, self.sensor)

    @property
    def pressure(self) -> NDArray[np.float64]:
        """(rows, cols) normal pressure, Pa; an `InvalidInput` if the sensor has no elastic gel."""
        if self.gel.pressure is None:
            raise InvalidInput(f"sensor {self.sensor.name} has no elastic gel, so pressure is unknown; give its file `gel: {{modulus: …}}`")
        return self.gel.pressure

    @property
    def force(self) -> float:
        """Normal force, N; an `InvalidInput` if the sensor has no elastic gel."""
        return normal_force(self.pressure, self.sensor)

    @property
    def success(self) -> bool:
        """Whether the sensor touches: more than 0.1 mm deep somewhere, and nowhere through the sensor plane."""
        return bool(touch_success(self.depth, self.sensor))

    @property
    def contact_area(self) -> float:
        """Area of the sensor plane under the contact, m²."""
        return float(self.contact.sum() * self.sensor.pitch[0] * self.sensor.pitch[1])

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) points of the object in the gel, world frame, m, row by row."""
        return sensor_to_world(self.pose, *masked_points(self.depth, self.contact, self.sensor).T)

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(n, 3) outward unit normals of the object at `points`, world frame, from differences of the depth in the contact."""
        surface = np.where(self.contact, self.depth, np.nan).astype(np.float64)
        slopes = [_slope(surface, axis) / size for axis, size in zip((1, 0), self.sensor.pitch[::-1], strict=True)]
        local = np.stack([*slopes, -np.ones_like(surface)], axis=-1)[self.contact]
        return np.asarray(local / np.linalg.norm(local, axis=1, keepdims=True) @ self.pose[:3, :3].T)

    @property
    def difference(self) -> NDArray[np.int16]:
        """(rows, cols, 3): the image minus that of the untouched sensor, levels."""
        return self.image.astype(np.int16) - untouched_image(self.sensor)


@dataclass(frozen=True, eq=False)
class Touches:
    """Hold the measurements of a sensor at N poses: (N, rows, cols) depth, (N, rows, cols, 3) image; `[n]` gives a `Touch`."""

    sensor: Sensor
    poses: NDArray[np.float64]
    depth: NDArray[np.float32]
    image: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.poses)

    def __repr__(self) -> str:
        return f"Touches({len(self)} of {self.sensor.name})"

    def __getitem__(self, number: int) -> Touch:
        number = operator.index(number)  # a slice would make one touch of several
        return Touch(self.sensor, self.poses[number], self.depth[number], self.image[number])


def touch(
    object_: TouchObject | Source,
    sensor: Sensor | str | Path,
    pose: np.ndarray,
    *,
    object_pose: np.ndarray | None = None,
    rng: np.random.Generator | None = None,
) -> Touch:
    """Press a sensor onto an object; both may have moved since the last time.

    Parameters
    ----------
    object_
        From `load_object`, or what that takes; a file is read again by each call.
    sensor
        From `load_sensor`, or what that takes.
    pose
        (4, 4) sensor frame to world frame, m: +z out of the gel, +x along image columns, origin in the middle of the gel's base.
    object_pose
        (4, 4) object frame to world frame; by default they are the same.
    rng
        Draws the pixel noise of a sensor that has some; None for an image without noise.

    Returns
    -------
    Depth and image; points, normals and area follow from them when they are asked for.

    Raises
    ------
    InvalidInput
        A pose is not a rigid motion.
    """
    object_, sensor, pose = as_object(object_), as_sensor(sensor), as_poses("pose", pose)
    seen_from = pose if object_pose is None else invert_pose(as_poses("object_pose", object_pose)) @ pose
    depth = ray_depth(object_.faces, seen_from, sensor).astype(np.float32)
    return Touch(sensor, pose, depth, tactile_image(depth, sensor, as_rng(rng)))


def touch_many(object_: TouchObject | Source, sensor: Sensor | str | Path, poses: np.ndarray, *, workers: int | None = None) -> Touches:
    """Press a sensor onto an object at many poses.

    Parameters
    ----------
    object_, sensor
        As in `touch`.
    poses
        (N, 4, 4) sensor frame to object frame, m; a single pose (4, 4) is one of one.
    workers
        Processes; by default one per core, fewer for few poses.

    Returns
    -------
    Depth and image of every pose, the same for any number of workers; without pixel noise.

    Raises
    ------
    InvalidInput
        A pose is not a rigid motion.
    """
    object_, sensor, checked = as_object(object_), as_sensor(sensor), as_poses("poses", poses, several=True)
    if workers is not None and (not isinstance(workers, int | np.integer) or workers < 1):
        raise TypeError(f"workers is a number of processes, 1 or more, or None; this is {workers!r}")
    depth: NDArray[np.float32] = _shared((len(checked), *sensor.shape), np.float32)
    image: NDArray[np.uint8] = _shared((len(checked), *sensor.shape, 3), np.uint8)

    def fill(numbers: range) -> None:
        for number in numbers:
            single = touch(object_, sensor, checked[number])
            depth[number], image[number] = single.depth, single.image

    _in_processes(fill, len(checked), workers or min(len(os.sched_getaffinity(0)), max(1, len(checked) // MIN_TOUCHES_PER_PROCESS)))
    return Touches(sensor, checked, depth, image)


def as_poses(name: str, values: Any, *, several: bool = False) -> NDArray[np.float64]:
    """Return a pose (4, 4), or several (N, 4, 4); errors name the expected shape, or what is wrong with a matrix."""
    try:
        poses = np.array(values, np.float64)  # a copy: points are computed when they are asked for
    except (TypeError, ValueError):  # no numbers, or not as many in each
        poses = np.zeros(())
    if several and poses.shape in ((4, 4), (0,)):
        poses = poses.reshape(-1, 4, 4)
    if poses.ndim != 2 + several or poses.shape[-2:] != (4, 4):
        expected, hint = ("(N, 4, 4)", "") if several else ("(4, 4)", "; touch_many takes several" if poses.ndim == 3 else "")
        received = f"an array {np.shape(values)}" if isinstance(values, np.ndarray) else type(values).__name__
        raise TypeError(f"{name} is {expected} numbers, a frame as a matrix; this is {received}{hint}")
    for number, pose in enumerate(poses.reshape(-1, 4, 4)):
        check_pose(pose, f"{name}[{number}]" if several else name)
    return poses


def as_rng(rng: np.random.Generator | None) -> np.random.Generator | None:
    """Return a generator, or None; a `TypeError` for anything else, which a sensor without noise would ignore."""
    if not isinstance(rng, np.random.Generator | None):
        raise TypeError(f"rng is a numpy.random.Generator, or None; this is {type(rng).__name__}")
    return rng


def as_sensor(sensor: Sensor | str | Path) -> Sensor:
    """Return a sensor as it is, or load it by name or path; a `TypeError` for anything else."""
    if isinstance(sensor, Sensor):
        return sensor
    if isinstance(sensor, str | Path):
        return load_sensor(sensor)
    raise TypeError(f"a sensor is the name of a shipped one, a sensor file, or what load_sensor returns; this is {type(sensor).__name__}")


def _in_processes(fill: Callable[[range], None], count: int, workers: int) -> None:
    """Call `fill` for every number below `count`, in forked processes that write to shared memory."""
    fill(range(min(count, 1)))  # here: the processes inherit compiled and cached functions
    if workers <= 1 or multiprocessing.current_process().daemon:  # which may not start any, as a DataLoader's
        return fill(range(1, count))
    context: Any = multiprocessing.get_context("fork")
    started = [context.Process(target=fill, args=(range(1 + k, count, workers),), daemon=True) for k in range(workers)]
    for process in started:
        process.start()
    for process in started:
        process.join()
    if failed := [process.exitcode for process in started if process.exitcode]:
        raise RuntimeError(f"{len(failed)} of {workers} processes ended with status {failed[0]}, see above; or take workers=1")


def _shared(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Make an array of zeros in memory that forked processes share."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.frombuffer(mmap.mmap(-1, max(size, 1)), dtype, count=int(np.prod(shape))).reshape(shape)


def _slope(surface: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Compute differences per pixel along an axis: central, one-sided where a neighbour is NaN, 0 where both are."""
    ahead = np.full_like(surface, np.nan)
    step = np.diff(surface, axis=axis)
    leading = (slice(None),) * axis
    ahead[(*leading, slice(None, -1))] = step
    behind = np.full_like(surface, np.nan)
    behind[(*leading, slice(1, None))] = step
    differences = np.where(np.isnan(ahead), behind, np.where(np.isnan(behind), ahead, (ahead + behind) / 2))
    return np.nan_to_num(differences)
