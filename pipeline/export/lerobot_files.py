"""Export to the layout of LeRobotDataset v3: an episode per object, a frame per grasp.

Images are PNG, depth is float32 and poses are float64 in the tables, so nothing is lost; LeRobot hands poses out as float32. Its own videos
would lose: MP4 compresses colours, and its depth has 12 bits.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import Meter, errors
from pipeline.export.grasp_frames import Column, GraspFrames
from pipeline.export.parquet_files import import_arrow, schema_of, table_of

VERSION = "v3.0"
FPS = 1
"""Frames per second: grasps are not a film; each follows one second after the last."""

FILE_BYTES = 100 * 10**6
"""Size of a data file after which the next one begins, as in LeRobot."""

CHUNK = 1000
"""Files per folder."""

NAMES = {"unoccluded": "observation.images.unoccluded", "occluded": "observation.images.occluded", "joint_angles": "observation.state"}
PREFIXES = {"tactile_image.": "observation.images.tactile_", "depth.": "observation.depth_"}
INDEX = {name: Column("int64") for name in ("frame_index", "episode_index", "index", "task_index")}


def write_lerobot(frames: GraspFrames, folder: Path) -> int:
    """Write `data`, `meta/info.json`, `meta/stats.json`, `meta/tasks.parquet` and `meta/episodes`; return the number of frames."""
    pa = import_arrow()
    columns = {_name(name): column for name, column in frames.columns.items()} | {"timestamp": Column("float32")} | INDEX
    tasks = sorted({_task(category) for category in frames.rows.categories})
    episodes: list[dict[str, Any]] = []
    statistics = {name: _Statistics(column) for name, column in columns.items() if column.kind != "string"}
    files, splits, index = _DataFiles(pa, folder, schema_of(columns)), {}, 0
    with Meter(errors, "export", sum(map(len, frames.object_ids.values())), "objects") as meter:
        for split, ids in frames.object_ids.items():
            splits[split] = f"{len(episodes)}:{len(episodes) + len(ids)}"
            for object_id in ids:
                rows, start = [], index
                for grasp, frame in enumerate(frames.frames(object_id, split)):
                    task, episode = tasks.index(_task(frame["category"])), len(episodes)
                    numbers = {"timestamp": grasp / FPS, "frame_index": grasp, "episode_index": episode, "index": index, "task_index": task}
                    named = {_name(name): value for name, value in frame.items()} | numbers
                    for name, column_statistics in statistics.items():
                        column_statistics.update(named[name])
                    rows.append(named)
                    index += 1
                chunk, file = files.write(table_of(rows, columns))
                places = {"data/chunk_index": chunk, "data/file_index": file, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
                span = {"dataset_from_index": start, "dataset_to_index": index}
                episodes.append({"episode_index": len(episodes), "tasks": [tasks[task]], "length": len(rows), **places, **span})
                meter.advance()
    files.close()
    _write_meta(pa, folder, episodes, tasks)
    info = {
        "codebase_version": VERSION,
        "robot_type": frames.rows.attributes("grasps").get("hand", {}).get("name", "unknown"),
        "total_episodes": len(episodes),
        "total_frames": index,
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": FILE_BYTES // 10**6,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": splits,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {name: _feature(column) for name, column in columns.items()},
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    (folder / "meta" / "stats.json").write_text(json.dumps({name: values.summary() for name, values in statistics.items()}, indent=4))
    return index


def _name(name: str) -> str:
    """Look up the name that LeRobot's policies know a column by."""
    for prefix, lerobot_prefix in PREFIXES.items():
        if name.startswith(prefix):
            return lerobot_prefix + name.removeprefix(prefix)
    return NAMES.get(name, f"observation.{name}" if name in ("hand_pose", "sensor_pose", "touch_success") else name)


def _feature(column: Column) -> dict[str, Any]:
    names = ["height", "width", "channels"] if column.kind == "image" else (list(column.names) or None)
    return {"dtype": column.kind, "shape": list(column.shape or (1,)), "names": names}


def _task(category: str) -> str:
    return f"grasp {'an' if category[:1].lower() in 'aeiou' else 'a'} {category}"


class _DataFiles:
    """Writes tables one after the other into files of about `FILE_BYTES`."""

    def __init__(self, pa: Any, folder: Path, schema: Any) -> None:
        self._pa, self._folder, self._schema = pa, folder, schema
        self._number, self._bytes, self._writer = -1, FILE_BYTES, None

    def write(self, table: Any) -> tuple[int, int]:
        """Write a table; return the numbers of its folder and its file."""
        if self._bytes >= FILE_BYTES:
            self.close()
            self._number, self._bytes = self._number + 1, 0
            path = self._folder / "data" / f"chunk-{self._number // CHUNK:03d}" / f"file-{self._number % CHUNK:03d}.parquet"
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = self._pa.parquet.ParquetWriter(path, self._schema, compression="snappy")
        assert self._writer is not None
        self._writer.write_table(table)
        self._bytes += table.nbytes
        return self._number // CHUNK, self._number % CHUNK

    def close(self) -> None:
        """Finish the file that is open."""
        if self._writer is not None:
            self._writer.close()


def _write_meta(pa: Any, folder: Path, episodes: list[dict[str, Any]], tasks: list[str]) -> None:
    import pandas

    (folder / "meta" / "episodes" / "chunk-000").mkdir(parents=True, exist_ok=True)
    pa.parquet.write_table(pa.Table.from_pylist(episodes), folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    table = pandas.DataFrame({"task_index": range(len(tasks))}, index=pandas.Index(tasks, name="task"))
    pa.parquet.write_table(pa.Table.from_pandas(table), folder / "meta" / "tasks.parquet")


class _Statistics:
    """Least, greatest, mean and standard deviation of a column's finite values; of images per channel, 0 to 1."""

    def __init__(self, column: Column) -> None:
        self._image = column.kind == "image"
        shape = (3, 1, 1) if self._image else column.shape or (1,)
        self._count, self._sum, self._squares = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self._min, self._max, self._frames = np.full(shape, np.inf), np.full(shape, -np.inf), 0

    def update(self, value: Any) -> None:
        """Include the value of a frame."""
        values = np.asarray(value, np.float64)
        parts = values.reshape(-1, 3).T[:, :, None] / 255 if self._image else values.reshape(1, *self._sum.shape)
        axis = 1 if self._image else 0
        finite = np.isfinite(parts)
        finite_parts = np.where(finite, parts, 0)
        shape = self._sum.shape
        self._frames += 1
        self._count += finite.sum(axis=axis).reshape(shape)
        self._sum += finite_parts.sum(axis=axis).reshape(shape)
        self._squares += (finite_parts**2).sum(axis=axis).reshape(shape)
        self._min = np.minimum(self._min, np.where(finite, parts, np.inf).min(axis=axis).reshape(shape))
        self._max = np.maximum(self._max, np.where(finite, parts, -np.inf).max(axis=axis).reshape(shape))

    def summary(self) -> dict[str, Any]:
        """Compute the statistics as LeRobot writes them; 0 if no value was finite."""
        count = np.maximum(self._count, 1)
        mean = self._sum / count
        spread = np.sqrt(np.maximum(self._squares / count - mean**2, 0))
        statistics = {"min": np.where(self._count, self._min, 0), "max": np.where(self._count, self._max, 0), "mean": mean, "std": spread}
        return {name: values.tolist() for name, values in statistics.items()} | {"count": [self._frames]}
