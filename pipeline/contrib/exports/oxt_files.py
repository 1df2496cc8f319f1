"""Export to the Zarr v2 layout of Open-X-Tactile, which FTP-1 is trained on: a store per task.

An episode is an object's grasps, a slide, or a lift; a frame is a grasp, or a step."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import zarr
from scipy.spatial.transform import Rotation

from pipeline.contrib.exports.functional_areas import joint_slots, tactile_areas
from pipeline.contrib.exports.grasp_frames import Column, Frames, distinct_names
from pipeline.contrib.exports.sequence_frames import open_frames
from pipeline.dataset.grasps import grasping_hand
from pipeline.errors import StoreError
from pipeline.store.storage import Location

CHUNK_BYTES = 2 * 10**6  # size of a chunk, or that of a frame if it is larger
KINDS = {  # group of a tactile array, and its type
    "tactile_image": ("image", "image"),
    "touch_success": ("contact", "binary"),
    "force": ("force", "state"),
    "torque": ("torque", "state"),
    "slip_share": ("slip_share", "state"),
    "pressure": ("pressure", "matrix"),
    "shear": ("shear", "matrix"),
    "slip": ("slip", "matrix"),
    "marker_displacement": ("markers", "matrix"),
}

END = Column("int64", meaning="Frame after the last one of each episode.")
TIME = Column("float64", unit="s", meaning="Time since the first frame; grasps follow one second after the last.")
INDEX_TIP = 1  # area of a sensor without a hand
WRIST = Column("float64", unit="m", meaning="Position and rotation vector, rad, of the hand's root link in the world.")
LABEL = Column("string")

Stream = tuple[np.ndarray, Column]  # (T, …)


def export_oxt(data: Location, folder: Path, of: str | None = None) -> str:
    """Write `SPLIT/grasp_CATEGORY.zarr`, `SPLIT/slide_CATEGORY.zarr`, or `SPLIT/lift_CATEGORY.zarr`."""
    frames = open_frames(data, of)
    if "tactile_image" not in frames.arrays:
        raise StoreError(f"{data.resolve()} has no touches; run simulate-touch, or simulate-slides with their images, then export again")
    streams, ends, tasks = _Streams(frames), Counter[Path](), distinct_names(sorted({*frames.rows.categories}), _slug)
    for split, episode in frames.episodes():
        path = folder / split / f"{frames.task.split()[0]}_{tasks[episode[0]['category']]}.zarr"
        ends[path] += len(episode)
        root = zarr.open_group(str(path), mode="a", zarr_format=2)
        _append(root.require_group("meta"), [("episode_ends", (np.array([ends[path]]), END))])
        _append(root.require_group("data"), streams.of(episode))
    return frames.summary


def _append(group: zarr.Group, streams: Iterable[tuple[str, Stream]]) -> None:
    """Write the next values of arrays."""
    for name, (values, column) in streams:
        if name in group:
            stored: Any = group[name]
            stored.append(values)
            continue
        chunks = (max(1, CHUNK_BYTES // values[0].nbytes), *values.shape[1:])
        attributes: dict[str, Any] = {"unit": column.unit, "description": column.meaning, "names": list(column.names)}
        group.create_array(name, data=values, chunks=chunks, compressors=numcodecs.Blosc("zstd"), attributes=attributes)


class _Streams:
    """Frames under the names of Open-X-Tactile."""

    def __init__(self, frames: Frames) -> None:
        self.frames, self.columns, self.fingers = frames, frames.columns, frames.labels["sensor"]
        self.side, self.slots, self.areas = "right", list[int](), [INDEX_TIP] * len(self.fingers)
        if self.has_hand:
            hand = grasping_hand({name: frames.rows.attributes(name) for name in frames.rows.collections})
            self.side = "left" if "left" in hand.name.lower() else "right"
            self.slots, self.areas = joint_slots(hand), tactile_areas(hand)
        texts = [*frames.rows.object_ids, *map(frames.instruction, frames.rows.categories)]
        self.text = f"<U{max(map(len, texts))}"  # of all episodes: a store cuts longer text that is appended

    @property
    def has_hand(self) -> bool:
        """Whether a hand holds the sensors: else there is no pose of a wrist, and no joint."""
        return "hand_pose" in self.columns

    def of(self, episode: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Stream]]:
        """Name the time-major arrays of an episode."""
        count, columns = len(episode), self.columns
        yield "timestamps", (np.arange(count) / self.frames.fps, TIME)
        yield "sub_task_instruction", (np.full(count, self.frames.instruction(episode[0]["category"]), self.text), LABEL)
        yield "object_id", (np.full(count, episode[0]["object_id"], self.text), columns["object_id"])
        if self.has_hand:
            pose = _stack(episode, "hand_pose")
            rotations = Rotation.from_matrix(pose[:, :3, :3]).as_rotvec()
            yield f"{self.side}_wrist_pose", (np.hstack([pose[:, :3, 3], rotations]), WRIST)
            yield f"{self.side}_hand_joints", (_stack(episode, "joint_angles"), columns["joint_angles"])
            yield f"{self.side}_hand_joints_idx", (np.tile(np.array(self.slots, np.int32), (count, 1)), LABEL)
        if camera := next((name for name in ("occluded", "unoccluded") if name in columns), None):
            yield "camera_main_rgb", (_stack(episode, camera), columns[camera])
        if "held" in columns:
            yield "held", (_stack(episode, "held"), columns["held"])
        for array in self.frames.arrays:
            if array in KINDS:
                yield from self._tactile(array, episode)

    def _tactile(self, array: str, episode: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Stream]]:
        """Name a tactile array's groups, one per kind of sensor."""
        quantity, kind = KINDS[array]
        by_finger = array in self.frames.by_finger
        values = np.stack([_stack(episode, f"{array}.{name}") for name in self.fingers], axis=1) if by_finger else _stack(episode, array)
        if kind in ("binary", "state"):
            values = values.reshape(*values.shape[:2], -1).astype(np.float32)  # (T, sensor, …)
        schema, sensors = self.frames.declaration(array), [episode[0][f"sensor.{finger}"] for finger in self.fingers]
        for sensor, written in distinct_names(sensors, _slug).items():
            of_kind = [number for number, other in enumerate(sensors) if other == sensor]
            fingers, group = tuple(self.fingers[number] for number in of_kind), f"{quantity}_{written}"
            described = Column("float32", names=fingers, unit=schema.units, meaning=schema.description)
            areas = np.tile([self.areas[number] for number in of_kind], (len(episode), 1))
            yield f"{self.side}_tactile_data_{group}", (values[:, of_kind], described)
            yield f"{self.side}_tactile_area_{group}", (areas, LABEL)
            yield f"{self.side}_tactile_sensor_{group}", (np.full(len(episode), sensor), LABEL)
            yield f"{self.side}_tactile_type_{group}", (np.full(len(episode), kind), LABEL)


def _stack(episode: Sequence[Mapping[str, Any]], column: str) -> np.ndarray:  # (T, …)
    return np.stack([frame[column] for frame in episode])


def _slug(name: str) -> str:
    """Write a name in the characters that names of stores and groups may have."""
    return re.sub("[^a-z0-9]+", "_", name.lower()).strip("_") or "other"
