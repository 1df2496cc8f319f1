"""`python -m benchmarks.training_memory DATA OUT`: peak memory of a training epoch over few objects and over many, and its seconds.

The datasets are the objects of DATA again and again under other names; DATA has every artifact. Each training is a process of its own.
DATA and OUT may be in object storage.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import cycle, islice
from pathlib import Path
from typing import Any

from benchmarks.provenance import provenance
from pipeline.config.manifest import Object
from pipeline.console import console
from pipeline.engine.plan import Request
from pipeline.engine.run import make_plans, run
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory
from pipeline.store.publish import publish_shard
from pipeline.store.reshard import shard_key, shard_of
from pipeline.store.storage import Place, names_in, place, remove
from pipeline.store.write import RowToPack
from schemas.catalogue import ARTIFACTS
from stages.registry import load_stage, resolve

OBJECTS_PER_SHARD = 100
VALID = 10
"""Every tenth object is for validation."""
TRAININGS = {
    "train-unet": ["width=1", "train-unet.epochs=1", "train-unet.batch_size=16"],
    "train-gcn": ["configuration=touch", "gcn_layers=2", "gcn_features=6", "train-gcn.epochs=1", "samples_per_object=1", "loss_points=100"],
}
"""Small networks: what counts is what is read."""


def objects(count: int) -> list[Object]:
    """Name the objects."""
    names = (f"copy-{number:06d}" for number in range(count))
    return [Object(name, "copy", {}, "train" if number % VALID else "valid") for number, name in enumerate(names)]


def replicate(source: Place, target: Place, count: int) -> None:
    """Write a dataset of `count` objects."""
    directory, shards = DataDirectory(target), -(-count // OBJECTS_PER_SHARD)
    directory.claim_shards(shards)
    origins = list(DataDirectory(source).collection(ARTIFACTS["surfaces"]))
    copies = list(zip(objects(count), islice(cycle(origins), count), strict=True))
    for name in ("surfaces", "grasps", "touch", "charts"):
        collection = DataDirectory(source).collection(ARTIFACTS[name])
        for number in range(shards):
            _write(directory, collection, [one for one in copies if shard_of(one[0].object_id, shards) == number], number, shards)


def _write(directory: DataDirectory, collection: Collection, copies: list[tuple[Object, str]], number: int, shards: int) -> None:
    first, artifact = collection.first, collection.artifact
    constants = {name: first.read(name) for name, array in artifact.arrays.items() if not array.per_object and first.has(name)}
    rows, packed = [], []
    for item, origin in copies:
        view, named = collection.view(origin), {"object_id": item.object_id, "split": item.split}
        rows.append(collection.row(origin).model_copy(update=named))
        packed.append(RowToPack(item.object_id, rows[-1].category, item.split, rows[-1].failure is None, view.shapes(), view.verify))
    key = shard_key(((row.key, row.split) for row in rows), number, shards, "copies")
    record = first.record.model_copy(update={"key": key, "rows": tuple(rows), "models": {}})
    publish_shard(directory, artifact, number, shards, record, packed, constants, first.attributes)


def train(stage: str, data: Place, count: int) -> str:
    """Train for an epoch in this process; what it took."""
    settings = resolve(stage, "draft", [*TRAININGS[stage], *(f"{stage}.{one}" for one in ("threads=1", "accelerator=cpu"))])
    request: Request[Any] = Request(load_stage(stage), settings, "copies", objects(count), "draft", 0, data)
    (plan,) = make_plans(request)
    planned = _peak()
    began = time.perf_counter()
    run(plan, console)
    return f"{stage}, {count} objects: {planned:.0f} MB when planned, {_peak():.0f} MB at most, {time.perf_counter() - began:.0f} s"


def _peak() -> float:
    """MB; what `getrusage` says would include the process that started this one."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) / 1e3  # type: ignore[index]


def figures(source: Place, out: Place, counts: list[int]) -> Iterator[str]:
    """Write the datasets that are not there yet, and train over each."""
    for count in counts:
        data = out / str(count)
        if not names_in(data):
            replicate(source, data, count)
        for stage in TRAININGS:
            remove(data / "models")
            command = [sys.executable, "-m", "benchmarks.training_memory", str(data), str(out), "--train", stage, "--objects", str(count)]
            yield subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip().splitlines()[-1]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=place)
    parser.add_argument("out", type=place)
    parser.add_argument("--objects", type=int, nargs="+", default=[200, 2000])
    parser.add_argument("--train", choices=TRAININGS, help="train over DATA in this process")
    asked = parser.parse_args()
    if asked.train:
        print(train(asked.train, asked.data, asked.objects[0]))
    else:
        print(provenance("python -m benchmarks.training_memory", "python -m benchmarks.training_memory"))
        for line in figures(asked.data, asked.out, asked.objects):
            print(line, flush=True)
