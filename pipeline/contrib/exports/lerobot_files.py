"""Export to the layout of LeRobotDataset v3: an episode per object, a frame per grasp.

Images are PNG, depth is float32 and poses are float64 in the tables, so nothing is lost; LeRobot hands poses out as float32. Its own videos
are lossy: MP4 compresses colours, and its depth has 12 bits.
"""

import json
import tempfile
from collections.abc import Callable, Mapping
from itertools import accumulate, pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np

from pipeline.contrib.exports.grasp_frames import Column, GraspFrames
from pipeline.contrib.exports.parquet_files import import_arrow, schema_of, table_of
from pipeline.store.storage import Location

VERSION = "v3.0"
FPS = 1
"""Frames per second: grasps are not a film; each follows one second after the last."""
FILE_BYTES = 100 * 10**6
"""Size of a data file after which the next one begins, as in LeRobot."""
CHUNK = 1000
"""Files per folder."""
QUANTILES = {"min": 0.0, "q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99, "max": 1.0}
"""Shares of a column's values, over all frames, by the names that LeRobot normalises by."""
BLOCK = 2**22
"""Values that are sorted at a time: memory does not grow with the dataset."""
NAMES = {"unoccluded": "observation.images.unoccluded", "occluded": "observation.images.occluded", "joint_angles": "observation.state"}
PREFIXES = {"tactile_image.": "observation.images.tactile_", "depth.": "observation.depth_"}
INDEX = {name: Column("int64") for name in ("frame_index", "episode_index", "index", "task_index")}


def export_lerobot(data: Location, folder: Path) -> str:
    """Write `data`, `meta/info.json`, `meta/stats.json`, `meta/tasks.parquet` and `meta/episodes`."""
    pa, frames = import_arrow(), GraspFrames(data)
    columns = {_name(name): column for name, column in frames.columns.items()} | {"timestamp": Column("float32")} | INDEX
    tasks = sorted({_task(category) for category in frames.rows.categories})
    episodes: list[dict[str, Any]] = []
    files, index = _DataFiles(pa, folder, schema_of(columns)), 0
    with tempfile.TemporaryFile(dir=folder) as spooled:
        statistics = _Statistics(columns, spooled)
        for _, _, object_frames in frames.objects():
            rows, start, task = [], index, tasks.index(_task(object_frames[0]["category"]))
            for grasp, frame in enumerate(object_frames):
                numbers = {
                    "timestamp": grasp / FPS,
                    "frame_index": grasp,
                    "episode_index": len(episodes),
                    "index": index,
                    "task_index": task,
                }
                rows.append({_name(name): value for name, value in frame.items()} | numbers)
                statistics.update(rows[-1])
                index += 1
            chunk, file = files.write(table_of(rows, columns))
            places = {"data/chunk_index": chunk, "data/file_index": file, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
            span = {"dataset_from_index": start, "dataset_to_index": index}
            episodes.append({"episode_index": len(episodes), "tasks": [tasks[task]], "length": len(rows), **places, **span})
        summary = statistics.summary()
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
        "splits": _splits(frames),
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {name: _feature(column) for name, column in columns.items()},
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    (folder / "meta" / "stats.json").write_text(json.dumps(summary, indent=4))
    return frames.summary


def _splits(frames: GraspFrames) -> dict[str, str]:
    """Name the episodes of each split: from the first to before the last."""
    ends = list(accumulate(map(len, frames.object_ids.values()), initial=0))
    return {split: f"{start}:{end}" for split, (start, end) in zip(frames.object_ids, pairwise(ends), strict=True)}


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
    """Exact statistics of all columns but strings: of finite numbers, which wait in `file`, and of the channels of images, 0 to 1."""

    def __init__(self, columns: Mapping[str, Column], file: IO[bytes]) -> None:
        numbers = {name: column for name, column in columns.items() if column.kind not in ("string", "image")}
        self._numbers = np.dtype([(name, column.kind, column.shape or (1,)) for name, column in numbers.items()])
        self._levels = {name: np.zeros((3, 256), np.int64) for name, column in columns.items() if column.kind == "image"}
        self._file, self._frames = file, 0

    def update(self, frame: Mapping[str, Any]) -> None:
        """Include a frame."""
        row = np.zeros((), self._numbers)
        for name in self._numbers.names or ():
            row[name] = frame[name]
        self._file.write(row.tobytes())
        for name, levels in self._levels.items():
            for channel, counts in enumerate(levels):
                counts += np.bincount(frame[name][..., channel].ravel(), minlength=256)
        self._frames += 1

    def summary(self) -> dict[str, dict[str, Any]]:
        """Compute the statistics of each column as LeRobot names and shapes them; 0 if no value was finite."""
        self._file.flush()
        rows = np.memmap(self._file, self._numbers, "r", shape=(self._frames,))
        summaries = {}
        for name in self._numbers.names or ():
            values = rows[name].reshape(self._frames, -1)
            step = max(1, BLOCK // self._frames)
            blocks = [_of_numbers(values[:, start : start + step]) for start in range(0, values.shape[1], step)]
            summaries[name] = {key: np.concatenate([block[key] for block in blocks]).reshape(rows[name].shape[1:]) for key in blocks[0]}
        for name, levels in self._levels.items():
            channels = [_of_levels(counts) for counts in levels]
            summaries[name] = {key: np.array([channel[key] for channel in channels])[:, None, None] for key in channels[0]}
        return {name: {key: value.tolist() for key, value in one.items()} | {"count": [self._frames]} for name, one in summaries.items()}


def _of_numbers(
    values: np.ndarray,  # (N, K)
) -> dict[str, np.ndarray]:
    """Compute the statistics of the finite values of each column; +inf is the only other one."""
    ordered = np.sort(values, axis=0)
    finite = np.isfinite(ordered)
    ordered, counts = np.where(finite, ordered, 0).astype(np.float64), finite.sum(axis=0)
    mean = ordered.sum(axis=0) / np.maximum(counts, 1)
    variance = (finite * (ordered - mean) ** 2).sum(axis=0) / np.maximum(counts, 1)
    return {"mean": mean, "std": np.sqrt(variance), **_quantiles(lambda index: ordered[index, np.arange(len(index))], counts)}


def _of_levels(
    counts: np.ndarray,  # (256,) pixels of each level
) -> dict[str, np.ndarray]:
    """Compute the statistics of a channel from its histogram."""
    levels, cumulative = np.arange(256) / 255, np.cumsum(counts)
    mean = counts @ levels / cumulative[-1]
    variance = counts @ (levels - mean) ** 2 / cumulative[-1]
    ordered = _quantiles(lambda index: levels[np.searchsorted(cumulative, index, side="right")], cumulative[-1])
    return {"mean": mean, "std": np.sqrt(variance), **ordered}


def _quantiles(ordered: Callable[[np.ndarray], np.ndarray], counts: np.ndarray) -> dict[str, np.ndarray]:
    """Interpolate quantiles between the sorted values that `ordered` returns at indices, as NumPy does."""
    quantiles = {}
    for name, share in QUANTILES.items():
        position = share * np.maximum(counts - 1, 0)
        below, above = (ordered(bound(position).astype(np.int64)) for bound in (np.floor, np.ceil))
        quantiles[name] = below + (position % 1) * (above - below)
    return quantiles
