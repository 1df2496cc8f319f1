"""Write a dataset of many objects that repeats the rows and models of a small one: `python -m benchmarks.many_objects DATA COUNT OUT`.

Stages that read a whole dataset, such as `evaluate`, take as long with it as with COUNT different objects, which would take hours to make.
OUT/many.yaml is its manifest; the models pass as trained on its objects.
"""

import shutil
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import yaml

from pipeline.config.manifest import load_manifest
from pipeline.store.directory import Collection, DataDirectory
from pipeline.store.publish import commit_shard
from pipeline.store.record import FolderRecord, read_record, serialise_with_checksum
from pipeline.store.rows import Chunks, Result, RowFiles
from schemas.base import COMMON, Artifact
from schemas.catalogue import ARTIFACTS

CLASSES = ("bottle", "cellphone", "knife", "rifle")


class RepeatedRows(RowFiles):
    """Reads the files of a few rows for many objects."""

    def __init__(self, work: Path, artifact: Artifact, results: Mapping[str, Result]) -> None:
        super().__init__(work, artifact)
        self.results = results  # of the small dataset's rows, by the name of an object that has this row

    def chunks(self, result: Result) -> Chunks:
        return super().chunks(self.results[result.name])


class RepeatedDirectory(DataDirectory):
    """A data directory into which repeated rows are published."""

    waiting: RepeatedRows

    def rows(self, artifact: Artifact) -> RowFiles:
        return self.waiting


def repeat(data: Path, count: int, out: Path) -> None:
    """Write `count` objects, the rows of each class in turn, and copy the models."""
    source, target = DataDirectory(data), RepeatedDirectory(out)
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    splits, counts = {"train": 0.6, "valid": 0.2, "test": 0.2}, dict.fromkeys(CLASSES, count // len(CLASSES))
    described = {"name": "many", "description": "Repeated objects.", "seed": 0, "splits": splits}
    described["sources"] = [{"kind": "procedural", "licence": "MIT", "seed": 0, "count": counts}]
    (out / "many.yaml").write_text(yaml.safe_dump(described))
    target.set_shard_count(1)
    for artifact in source.artifacts():
        _repeat_artifact(source.collection(artifact), target, out / "many.yaml")
    shutil.copytree(data / "models", out / "models")
    directory = DataDirectory(out)
    for path in (out / "models").rglob("*.json"):
        if "location" in path.read_text() and path.with_suffix("").relative_to(out).as_posix() in directory.folders():
            record = read_record(path, FolderRecord)
            inputs = {name: directory.collection(ARTIFACTS[name]).rows_digest(record.splits) for name in record.inputs}
            path.write_bytes(serialise_with_checksum(record.model_copy(update={"inputs": inputs})))


def _repeat_artifact(collection: Collection, target: RepeatedDirectory, manifest: Path) -> None:
    (shard,), artifact = collection.shards, collection.artifact
    by_class = defaultdict(list)
    for name in collection:
        by_class[collection.row(name).category].append(name)
    work = Path(str(target.work(artifact.name)))
    saved = {}
    for name in collection:
        row, key = collection.view(name).verify(), collection.row(name).key
        saved[name] = RowFiles(work, artifact).save(Result(name=name, key=key), row, collection.row(name).category)
    rows, originals = [], {}
    for number, item in enumerate(sorted(load_manifest(str(manifest)).objects(None), key=lambda item: item.object_id)):
        of_class = by_class[item.category]
        original = of_class[number % len(of_class)]
        rows.append(collection.row(original).model_copy(update={"object_id": item.object_id, "split": item.split}))
        originals[item.object_id] = saved[original]
    target.waiting = RepeatedRows(work, artifact, originals)
    results = [originals[row.object_id].model_copy(update={"name": row.object_id}) for row in rows]
    constants = {name: shard.read(name) for name, array in artifact.arrays.items() if name not in COMMON and not array.per_object}
    ours = ("schema", "schema_version", "stage", "settings", "seed", "manifest", "failures")
    attributes = {name: value for name, value in shard.attributes.items() if name not in ours}
    record = shard.record.model_copy(update={"rows": tuple(rows), "manifest": "many", "options": {"--manifest": str(manifest)}})
    commit_shard(target, artifact, target.shard_record(artifact.name, 0, 1), record, results, constants, attributes)
    shutil.rmtree(work)


if __name__ == "__main__":
    repeat(Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
