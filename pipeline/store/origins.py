"""Check that artifacts and folders of a data directory were made from the current inputs."""

from collections.abc import Container, Iterable

from pipeline.errors import StoreError
from pipeline.store.directory import DataDirectory, made_by
from schemas.catalogue import ARTIFACTS


def check_origins(directory: DataDirectory, names: Iterable[str], objects: Container[str] | None = None) -> None:
    """Check that artifacts and folders, and all that they were made from, were made from the current inputs.

    With `objects`, check the rows of these alone: their shards may be remade before others. By default check all, which
    must belong together. A `StoreError` names what was made from something else, has other splits, or has shards that
    were made with different settings, and what to run again.
    """
    checked: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in checked:
            checked.add(name)
            waiting += _check_artifact(directory, name, objects) if name in ARTIFACTS else _check_folder(directory, name)


def _check_artifact(directory: DataDirectory, name: str, objects: Container[str] | None) -> list[str]:
    """Check an artifact; return the names of its inputs."""
    collection = directory.collection(ARTIFACTS[name])
    if objects is None:
        collection.check_alike()
    used: set[str] = set()
    for shard in collection.shards:
        again = f"run {shard.record.stage} again"
        used |= shard.record.models.keys()
        for model, made_with in shard.record.models.items():
            if directory.folder(model).digest() != made_with:
                raise StoreError(f"{shard.path} was made with another {model} than the current one; {again}")
        for row in shard.record.rows:
            if objects is not None and row.object_id not in objects:
                continue
            used |= row.inputs.keys() & ARTIFACTS.keys()
            for origin in row.inputs.keys() & ARTIFACTS.keys():
                current = directory.collection(ARTIFACTS[origin])
                if current.shards and (row.object_id not in current or current.row(row.object_id).digest != row.inputs[origin]):
                    raise StoreError(f"{shard.path}: {name} of {row.object_id} was made from other {origin} than the current ones; {again}")
                if current.shards and (split := current.row(row.object_id).split) != row.split:
                    maker = current.shard(row.object_id).record.stage
                    raise StoreError(
                        f"{shard.path} has other splits than {origin}: {row.object_id} is {row.split} in {name} and {split} there; "
                        f"run {maker} and {shard.record.stage} again with one manifest, which computes nothing"
                    )
    return sorted(used)


def _check_folder(directory: DataDirectory, name: str) -> list[str]:
    record, path = directory.folder(name), directory.folder_record(name)
    again = f"run {made_by(name, record)} again with the settings in {path}, or delete that file if this folder is no longer needed"
    if unknown := sorted(record.inputs.keys() - ARTIFACTS.keys()):
        raise StoreError(f"{path}: there is no artifact {unknown[0]}; delete the record and run {made_by(name, record)} again")
    for artifact, made_from in record.inputs.items():
        if directory.collection(ARTIFACTS[artifact]).rows_digest(record.splits) != made_from:
            raise StoreError(f"{directory.root / name} was made from other {artifact} than the current ones; {again}")
    for model, made_with in record.models.items():
        if directory.folder(model).digest() != made_with:
            raise StoreError(f"{directory.root / name} was made from another {model} than the current one; {again}")
    return [*record.inputs, *record.models]
