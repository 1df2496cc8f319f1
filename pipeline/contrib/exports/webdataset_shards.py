"""Export to WebDataset: tar shards per split, a sample per grasp or step; images as PNG, arrays as NPY, others as JSON."""

import io
import json
import tarfile
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.contrib.exports.grasp_frames import Column, distinct_names
from pipeline.contrib.exports.sequence_frames import open_frames
from pipeline.formats.image_file import encode_image
from pipeline.store.storage import Location

SHARD_BYTES = 100 * 10**6  # size of a shard after which the next one begins, as WebDataset advises


def export_webdataset(data: Location, folder: Path, of: str | None = None) -> str:
    """Write `SPLIT-NNNNNN.tar`; the files of a sample are called KEY.COLUMN.png, KEY.COLUMN.npy and KEY.json.

    `columns.json` describes the columns: type, shape, names along the first axis, unit and meaning.
    """
    frames = open_frames(data, of)
    files = distinct_names(frames.columns, lambda name: name.replace(".", "_"))  # a key ends at the first dot
    described = {name: asdict(column) for name, column in frames.columns.items()}
    (folder / "columns.json").write_text(json.dumps(described, indent=1), encoding="utf-8")
    samples, shards, shard = Counter[str](), Counter[str](), None
    with ExitStack() as opened:
        for split, rows in frames.episodes():
            for frame in rows:
                if shard is None or not samples[split] or shard.offset >= SHARD_BYTES:
                    opened.close()  # the shard before
                    shard = opened.enter_context(tarfile.open(folder / f"{split}-{shards[split]:06d}.tar", "w"))
                    shards[split] += 1
                _add_sample(shard, f"{samples[split]:08d}", frame, frames.columns, files)
                samples[split] += 1
    return frames.summary


def _add_sample(shard: tarfile.TarFile, key: str, frame: dict[str, Any], columns: dict[str, Column], files: dict[str, str]) -> None:
    scalars = {}
    for name, column in columns.items():
        value, file = frame[name], files[name]
        if column.kind == "image":
            _add(shard, f"{key}.{file}.png", encode_image(value))
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
