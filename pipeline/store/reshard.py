"""Split the objects of a data directory into another number of shards."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence

from pipeline.console import abbreviate
from pipeline.errors import StoreError, first_line
from pipeline.store import digest
from pipeline.store.atomic import exclusive_lock, write_atomically
from pipeline.store.collection import Collection
from pipeline.store.directory import DESCRIPTION, WORK, DataDirectory, DatasetDescription, has_shard_count
from pipeline.store.publish import ShardOutput, withdraw
from pipeline.store.record import RowRecord
from pipeline.store.row_files import Chunks, encode_row
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from pipeline.store.storage import Location, list_folder, map_in_threads, read_bytes
from schemas.catalogue import ARTIFACTS


def shard_of(object_id: str, shards: int) -> int:
    """Compute the number of an object's shard from its name alone: adding or removing other objects does not move it."""
    return int(hashlib.sha256(object_id.encode()).hexdigest(), 16) % shards


def shard_key(
    rows: Iterable[tuple[str, str]], number: int, shards: int, manifest: str, missing: Iterable[str] = (), labels: Row | None = None
) -> str:
    """Compute the key of a shard from the keys and splits of its rows, the names of the objects that it lacks, and its inputs' labels."""
    lacks = {"missing": names} if (names := list(missing)) else {}
    labelled = {"labels": digest.of_arrays(labels)} if labels else {}
    return digest.of_json({"rows": list(rows), "shard": [number, shards], "manifest": manifest, **lacks, **labelled})


def reshard(directory: DataDirectory, shards: int) -> Iterator[Location]:
    """Write every artifact's rows into another number of shards, then publish all at once; yield each group's path.

    Nothing is computed. If it is killed before its end, readers see no change. No shard is locked: a stage that
    publishes meanwhile is detected at the end (a `StoreError`), and one that publishes later finds another number of
    shards, and keeps its rows for the next run.
    """
    if directory.shards() is None:
        raise StoreError(f"{directory.root} holds no shards; `vt-pipeline run` makes some")
    try:
        with exclusive_lock(directory.root / WORK / "reshard.lock", directory.root):
            yield from _reshard(directory, shards)
    except OSError as error:
        raise StoreError(
            f"{error.filename or directory.root} cannot be written ({error.strerror or first_line(error)}), so readers see the previous "
            f"shards; make {directory.root} writable, with room on its disk, or copy it to another disk, then run again"
        ) from error


def _reshard(directory: DataDirectory, shards: int) -> Iterator[Location]:
    root, old_shards = directory.root, directory.shards()
    if old_shards in (None, shards):
        for record in directory.shard_records():  # those of other numbers: a run of this command was killed towards its end
            if not has_shard_count(record, old_shards):
                withdraw(record)
        return
    _check_no_runs(directory, old_shards)
    _discard_records(directory, shards)  # of a run of this command that was killed
    snapshot = _contents(directory, old_shards)
    directory = DataDirectory(root)  # without records that were read before the snapshot
    for artifact in directory.artifacts():
        collection = directory.collection(artifact)
        collection.check_alike()  # others cannot become one shard
        _check_missing(collection, shards)
        for number in range(shards):
            if members := [name for name in collection if shard_of(name, shards) == number]:
                yield _write(directory, collection, members, number, shards)
    _set_shards(directory, shards)
    if _contents(directory, old_shards) != snapshot:
        _set_shards(directory, old_shards)
        _discard_records(directory, shards)
        raise StoreError(f"{root}: a stage published rows meanwhile, so the number of shards is unchanged; wait for runs to end")
    _discard_records(directory, old_shards)


def _check_no_runs(directory: DataDirectory, shards: int) -> None:
    """Raise an error if a stage is running, because resharding would fail at the end, or if an artifact's package is not installed."""
    for record in directory.shard_records():
        if record.parent.name not in ARTIFACTS:
            raise StoreError(f"{record.parent} is an artifact of a package that is not installed; install it, or remove that folder first")
    names = list_folder(directory.root / WORK).keys() | {artifact.name for artifact in directory.artifacts()}
    for name in sorted(names & ARTIFACTS.keys()):
        for number in range(shards):
            with exclusive_lock(directory.shard_lock(name, number, shards), directory.root / name):
                pass


def _contents(directory: DataDirectory, shards: int) -> dict[Location, bytes]:
    """Read the current records of this number of shards."""
    paths = [path for path in directory.shard_records() if has_shard_count(path, shards)]
    return dict(zip(paths, map_in_threads(_content, paths), strict=True))


def _content(record: Location) -> bytes:
    """Read a record; empty if it was withdrawn since it was listed."""
    try:
        return read_bytes(record)
    except FileNotFoundError:
        return b""


def _set_shards(directory: DataDirectory, shards: int) -> None:
    write_atomically(directory.root / DESCRIPTION, DatasetDescription(shards=shards).model_dump_json().encode())


def _discard_records(directory: DataDirectory, shards: int) -> None:
    """Remove the records of this number of shards."""
    for path in directory.shard_records():
        if has_shard_count(path, shards):
            withdraw(path)


def _check_missing(collection: Collection, shards: int) -> None:
    """Raise an error if a shard would have no row, but objects that are not made yet: only a shard with rows can name them."""
    made = {shard_of(name, shards) for name in collection}
    if forgotten := [name for name in collection.missing if shard_of(name, shards) not in made]:
        stage = collection.first.record.stage
        raise StoreError(f"{collection.folder}: {abbreviate(forgotten)} not made yet; run {stage} without --object first")


def _row_with_processor(shard: Shard, object_id: str) -> RowRecord:
    """Copy the record of a row, with the processor that computed it."""
    row = shard.row(object_id)
    return row.model_copy(update={"processor": shard.record.processor_of(row)})


def _write(directory: DataDirectory, collection: Collection, members: Sequence[str], number: int, shards: int) -> Location:
    first, artifact = collection.first, collection.artifact
    rows = tuple(_row_with_processor(collection.shard(name), name) for name in members)
    attributes = {**first.attributes, "failures": {row.object_id: row.failure.model_dump() for row in rows if row.failure}}
    constants = {name: first.read(name) for name, array in artifact.arrays.items() if not array.per_object and first.has(name)}
    missing = tuple(name for name in collection.missing if shard_of(name, shards) == number)
    origins = {origin for row in rows for origin in row.inputs.keys() & ARTIFACTS.keys()}
    labelled = {name for origin in origins for name, array in ARTIFACTS[origin].arrays.items() if array.is_coordinate}
    labels = {name: constants[name] for name in labelled & constants.keys()}
    key = shard_key(((row.key, row.split) for row in rows), number, shards, first.record.manifest, missing, labels)
    record = first.record.model_copy(update={"key": key, "rows": rows, "missing": missing})
    shapes = [collection.view(name).shapes() for name in members]

    def encoded(number: int) -> Chunks:
        return encode_row(artifact, collection.view(members[number]).verify())

    return ShardOutput(directory, artifact, number, shards).commit(record, shapes, encoded, constants, attributes)
