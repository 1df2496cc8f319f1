"""Export to the Zarr v2 layout of Open-X-Tactile, which FTP-1 is trained on: a store per task, an episode per object, a frame per grasp."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import zarr
from scipy.spatial.transform import Rotation

from pipeline.contrib.exports.functional_areas import joint_slots, tactile_areas
from pipeline.contrib.exports.grasp_frames import BY_FINGER, Column, GraspFrames
from pipeline.dataset.grasps import grasping_hand
from pipeline.errors import StoreError
from pipeline.store.storage import Location
from schemas.catalogue import artifact_of

CHUNK_BYTES = 2 * 10**6
"""Least size of a chunk of more than one frame."""
KINDS = {
    "tactile_image": ("image", "image"),
    "touch_success": ("contact", "binary"),
    "force": ("force", "state"),
    "pressure": ("pressure", "matrix"),
}
"""The group of a tactile array, and its type."""

Stream = tuple[np.ndarray, Column]  # (T, …)


def export_oxt(data: Location, folder: Path) -> str:
    """Write `SPLIT/grasp_CATEGORY.zarr`."""
    frames = GraspFrames(data)
    if "tactile_image" not in frames.arrays:
        raise StoreError(f"{data.resolve()} has no touches; run simulate-touch, then export again")
    categories = dict(zip(frames.rows.object_ids, frames.rows.categories, strict=True))
    episodes = Counter((split, categories[name]) for split, names in frames.object_ids.items() for name in names)
    streams, stores = _Streams(frames), dict[tuple[str, str], _Store]()
    for split, episode in frames.objects():
        task = split, episode[0]["category"]
        if task not in stores:
            stores[task] = _Store(folder / split / f"grasp_{_slug(task[1])}.zarr", frames.grasps, episodes[task])
        stores[task].append(dict(streams.of(episode)))
    return frames.summary


class _Store:
    """The store of a task, with room for all of its episodes."""

    def __init__(self, path: Path, frames: int, episodes: int) -> None:
        root = zarr.create_group(str(path), zarr_format=2)
        root.create_group("meta").create_array("episode_ends", data=np.arange(1, episodes + 1, dtype=np.int64) * frames)
        self.data, self.frames, self.total, self.written = root.create_group("data"), frames, frames * episodes, 0

    def append(self, streams: Mapping[str, Stream]) -> None:
        """Write the next episode."""
        for name, (values, column) in streams.items():
            if not self.written:
                self.data.create_array(
                    name,
                    shape=(self.total, *values.shape[1:]),
                    dtype=values.dtype,
                    chunks=(min(max(1, CHUNK_BYTES // values[0].nbytes), self.total), *values.shape[1:]),
                    compressors=numcodecs.Blosc("zstd"),
                    attributes={"unit": column.unit, "description": column.meaning, "names": list(column.names)},
                )
            stored: Any = self.data[name]
            stored[self.written : self.written + self.frames] = values
        self.written += self.frames


class _Streams:
    """Frames under the names of Open-X-Tactile."""

    def __init__(self, frames: GraspFrames) -> None:
        hand = grasping_hand({name: frames.rows.attributes(name) for name in frames.rows.collections})
        self.columns, self.fingers = frames.columns, frames.labels["sensor"]
        self.side = "left" if "left" in hand.name.lower() else "right"
        self.slots, self.areas = joint_slots(hand), tactile_areas(hand)
        self.text = f"<U{max(map(len, frames.rows.object_ids))}"

    def of(self, episode: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Stream]]:
        """Name the time-major arrays of an episode."""
        count, columns, category = len(episode), self.columns, episode[0]["category"]
        yield (
            "timestamps",
            (np.arange(count), Column("int64", unit="s", meaning="Number of the grasp: each follows one second after the last.")),
        )
        instruction = f"grasp {'an' if category[:1].lower() in 'aeiou' else 'a'} {category}."
        yield "sub_task_instruction", (np.full(count, instruction), columns["category"])
        yield "object_id", (np.full(count, episode[0]["object_id"], self.text), columns["object_id"])
        pose = _stack(episode, "hand_pose")
        rotations = Rotation.from_matrix(pose[:, :3, :3]).as_rotvec()
        meaning = "Position and rotation vector, rad, of the hand's root link in the world."
        yield f"{self.side}_wrist_pose", (np.hstack([pose[:, :3, 3], rotations]), Column("float64", unit="m", meaning=meaning))
        yield f"{self.side}_hand_joints", (_stack(episode, "joint_angles"), columns["joint_angles"])
        yield f"{self.side}_hand_joints_idx", (np.tile(np.int32(self.slots), (count, 1)), Column("int64", meaning="Slots of the joints."))
        if camera := next((name for name in ("occluded", "unoccluded") if name in columns), None):
            yield "camera_main_rgb", (_stack(episode, camera), columns[camera])
        if "held" in columns:
            yield "held", (_stack(episode, "held"), columns["held"])
        for array in KINDS:
            if any(name.partition(".")[0] == array for name in columns):
                yield from self._tactile(array, episode)

    def _tactile(self, array: str, episode: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, Stream]]:
        """Name a tactile array's groups, one per kind of sensor."""
        quantity, kind = KINDS[array]
        names = [f"{array}.{finger}" for finger in self.fingers] if array in BY_FINGER else [array]
        values = np.stack([_stack(episode, name) for name in names], axis=1) if array in BY_FINGER else _stack(episode, array)
        values = values[..., None].astype(np.float32) if kind in ("binary", "state") else values  # (T, sensor, …)
        schema, sensors = artifact_of(array).arrays[array], [episode[0][f"sensor.{finger}"] for finger in self.fingers]
        for sensor in dict.fromkeys(sensors):
            of_kind = [number for number, other in enumerate(sensors) if other == sensor]
            fingers, group = tuple(self.fingers[number] for number in of_kind), f"{quantity}_{_slug(sensor)}"
            described = Column("float32", names=fingers, unit=schema.units, meaning=schema.description)
            areas = np.tile([self.areas[number] for number in of_kind], (len(episode), 1))
            labels = {"area": areas, "sensor": np.full(len(episode), sensor), "type": np.full(len(episode), kind)}
            for member, one in {"data": values[:, of_kind], **labels}.items():
                yield f"{self.side}_tactile_{member}_{group}", (one, described if member == "data" else Column("string"))


def _stack(episode: Sequence[Mapping[str, Any]], column: str) -> np.ndarray:  # (T, …)
    return np.stack([frame[column] for frame in episode])


def _slug(name: str) -> str:
    """Write a name in the characters that names of stores and groups may have."""
    return re.sub("[^a-z0-9]+", "_", name.lower()).strip("_")
