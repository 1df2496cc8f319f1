"""Export to WebDataset: tar shards per split, a sample per grasp; images as PNG, arrays as NPY, the rest as JSON; lossless."""

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.console import Meter, errors
from pipeline.contrib.exports.grasp_frames import Column, GraspFrames, png

SAMPLES = 1000
"""Per shard: about a hundred MB, as WebDataset advises."""


def write_webdataset(frames: GraspFrames, folder: Path) -> int:
    """Write `SPLIT-NNNNNN.tar`; the files of a sample are called KEY.COLUMN.png, KEY.COLUMN.npy and KEY.json. Returns the samples."""
    folder.mkdir(parents=True, exist_ok=True)
    count = 0
    with Meter(errors, "export", sum(map(len, frames.object_ids.values())), "objects") as meter:
        for split, ids in frames.object_ids.items():
            shard, index = None, 0
            for object_id in ids:
                for frame in frames.frames(object_id, split):
                    if index % SAMPLES == 0:
                        if shard is not None:
                            shard.close()
                        shard = tarfile.open(folder / f"{split}-{index // SAMPLES:06d}.tar", "w")  # noqa: SIM115 (closed above and below)
                    assert shard is not None
                    _add_sample(shard, f"{index:08d}", frame, frames.columns)
                    index, count = index + 1, count + 1
                meter.advance()
            if shard is not None:
                shard.close()
    return count


def _add_sample(shard: tarfile.TarFile, key: str, frame: dict[str, Any], columns: dict[str, Column]) -> None:
    scalars = {}
    for name, column in columns.items():
        value, file = frame[name], name.replace(".", "_")  # a key ends at the first dot
        if column.kind == "image":
            _add(shard, f"{key}.{file}.png", png(value))
        elif column.shape:
            buffer = io.BytesIO()
            np.save(buffer, value, allow_pickle=False)
            _add(shard, f"{key}.{file}.npy", buffer.getvalue())
        else:
            scalars[name] = value
    _add(shard, f"{key}.json", json.dumps(scalars).encode())


def _add(shard: tarfile.TarFile, name: str, content: bytes) -> None:
    info = tarfile.TarInfo(name)  # without times and owners: the same dataset gives the same bytes
    info.size = len(content)
    shard.addfile(info, io.BytesIO(content))
