"""Export to the layout of LeRobotDataset v3: an episode per object, a frame per grasp; or per slide or lift, a frame per step.

Images are PNG, depth is float32 and poses are float64 in the tables, so nothing is lost; LeRobot hands poses out as float32. Its own videos
are lossy: MP4 compresses colours, and its depth has 12 bits.
"""

import json
import tempfile
import warnings
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack
from itertools import accumulate, pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np

from pipeline.contrib.exports.grasp_frames import Column
from pipeline.contrib.exports.parquet_files import import_arrow, schema_of, table_of
from pipeline.contrib.exports.sequence_frames import open_frames
from pipeline.store.storage import Location

VERSION = "v3.0"
FILE_BYTES = 100 * 10**6  # size of a data file after which the next one begins, as in LeRobot
CHUNK = 1000  # files per folder
QUANTILES = {"min": 0.0, "q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99, "max": 1.0}
"""Shares of a column's values, over all frames, by the names that LeRobot normalises by."""
BLOCK = 2**22  # values that are sorted at a time: memory does not grow with the dataset
NAMES = {"unoccluded": "observation.images.unoccluded", "occluded": "observation.images.occluded", "joint_angles": "observation.state"}
INDEX = {name: Column("int64") for name in ("frame_index", "episode_index", "index", "task_index")}


def export_lerobot(data: Location, folder: Path, of: str | None = None) -> str:
    """Write `data`, `meta/info.json`, `meta/stats.json`, `meta/tasks.parquet` and `meta/episodes`."""
    pa, frames = import_arrow(), open_frames(data, of)
    import pandas

    columns = {_name(name): column for name, column in frames.columns.items()} | {"timestamp": Column("float32")} | INDEX
    schema, tasks = schema_of(columns), sorted({frames.instruction(category) for category in frames.rows.categories})
    episodes, splits = list[dict[str, Any]](), Counter[str]()
    index, number, size = 0, -1, FILE_BYTES  # of the next frame; of the current data file, and its bytes
    with tempfile.TemporaryFile(dir=folder) as spooled, ExitStack() as opened:
        statistics = _Statistics(columns, spooled)
        for split, episode in frames.episodes():
            task = tasks.index(frames.instruction(episode[0]["category"]))
            splits[split] += 1
            rows = []
            for frame_number, frame in enumerate(episode):
                numbers = {"frame_index": frame_number, "episode_index": len(episodes), "index": index + frame_number, "task_index": task}
                rows.append({_name(name): value for name, value in frame.items()} | {"timestamp": frame_number / frames.fps} | numbers)
                statistics.update(rows[-1])
            if size >= FILE_BYTES:
                opened.close()  # the file before
                number, size = number + 1, 0
                path = folder / "data" / f"chunk-{number // CHUNK:03d}" / f"file-{number % CHUNK:03d}.parquet"
                path.parent.mkdir(parents=True, exist_ok=True)
                writer = opened.enter_context(pa.parquet.ParquetWriter(path, schema, compression="snappy"))
            table = table_of(rows, columns, schema)
            writer.write_table(table)
            size += table.nbytes
            files = {"data/chunk_index": number // CHUNK, "data/file_index": number % CHUNK}
            files |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
            span = {"dataset_from_index": index, "dataset_to_index": index + len(rows)}
            episodes.append({"episode_index": len(episodes), "tasks": [tasks[task]], "length": len(rows), **files, **span})
            index += len(rows)
        summary = statistics.summary()
    ends = list(accumulate(splits.values(), initial=0))
    info = {
        "codebase_version": VERSION,
        "robot_type": frames.hand,
        "total_episodes": len(episodes),
        "total_frames": index,
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": FILE_BYTES // 10**6,
        "video_files_size_in_mb": 200,
        "fps": int(frames.fps) if frames.fps.is_integer() else frames.fps,
        "splits": {split: f"{start}:{end}" for split, (start, end) in zip(splits, pairwise(ends), strict=True)},  # of episodes
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {name: _feature(column) for name, column in columns.items()},
    }
    meta = folder / "meta"
    (meta / "episodes" / "chunk-000").mkdir(parents=True)
    pa.parquet.write_table(pa.Table.from_pylist(episodes), meta / "episodes" / "chunk-000" / "file-000.parquet")
    table = pandas.DataFrame({"task_index": range(len(tasks))}, index=pandas.Index(tasks, name="task"))
    pa.parquet.write_table(pa.Table.from_pandas(table), meta / "tasks.parquet")
    (meta / "info.json").write_text(json.dumps(info, indent=4))
    (meta / "stats.json").write_text(json.dumps(summary, indent=4))
    return frames.summary


def _name(name: str) -> str:
    """Look up the name that LeRobot's policies know a column by."""
    array, _, finger = name.partition(".")
    if finger and array != "sensor":
        return f"observation.images.tactile_{finger}" if array == "tactile_image" else f"observation.{array}_{finger}"
    return NAMES.get(name, f"observation.{name}" if name in ("hand_pose", "sensor_pose", "touch_success") else name)


def _feature(column: Column) -> dict[str, Any]:
    names = ["height", "width", "channels"] if column.kind == "image" else (list(column.names) or None)
    described = {"unit": column.unit, "description": column.meaning} if column.meaning else {}
    return {"dtype": column.kind, "shape": list(column.shape or (1,)), "names": names, **described}


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
    finite = np.where(np.isfinite(values), values, np.nan).astype(np.float64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of columns without a finite value
        quantiles = np.nanquantile(finite, list(QUANTILES.values()), axis=0)
        summary = {"mean": np.nanmean(finite, axis=0), "std": np.nanstd(finite, axis=0), **dict(zip(QUANTILES, quantiles, strict=True))}
    return {name: np.nan_to_num(value) for name, value in summary.items()}


def _of_levels(
    counts: np.ndarray,  # (256,) pixels of each level
) -> dict[str, Any]:
    """Compute the statistics of a channel from its histogram."""
    levels, cumulative = np.arange(256) / 255, np.cumsum(counts)
    mean = counts @ levels / cumulative[-1]
    position = np.array(list(QUANTILES.values())) * (cumulative[-1] - 1)
    below, above = (levels[np.searchsorted(cumulative, bound(position), side="right")] for bound in (np.floor, np.ceil))
    quantiles = below + (position % 1) * (above - below)
    std = np.sqrt(counts @ (levels - mean) ** 2 / cumulative[-1])
    return {"mean": mean, "std": std, **dict(zip(QUANTILES, quantiles, strict=True))}
