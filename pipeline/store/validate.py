"""Check shards and folders against their schemas, records, digests and inputs; each problem is one line."""

from collections.abc import Container, Iterable, Iterator

import numpy as np

from pipeline.console import abbreviate, pluralise
from pipeline.errors import StoreError
from pipeline.store import digest
from pipeline.store.digest import files_of
from pipeline.store.directory import DataDirectory, made_by, record_of
from pipeline.store.garbage import all_unreferenced
from pipeline.store.record import RowRecord, ShardRecord, read_record
from pipeline.store.rows import are_valid
from pipeline.store.shard import RowView, Shard
from pipeline.store.storage import Location, exists
from pipeline.store.stored_array import schema_violations
from schemas.base import COMMON
from schemas.catalogue import ARTIFACTS


def problems_below(root: Location, *, strict: bool = False) -> dict[Location, list[str]]:
    """Check a data directory; return the problems by path of record, an empty list for a record without problems.

    A `strict` check also objects to artifacts that several kinds of processors computed.
    """
    directory = DataDirectory(root)
    problems: dict[Location, list[str]] = {}
    for name in ARTIFACTS:
        for path in (records := directory.shard_records(name)):
            try:
                problems[path] = problems_of(Shard(path.parent, ARTIFACTS[name], read_record(path, ShardRecord)))
            except StoreError as error:
                problems[path] = [str(error)]
        if records:
            checks = [_origin_problems(directory, name), *([_mixed_processors(directory, name)] if strict else [])]
            if lines := [line for check in checks for line in _collect_lines(check)]:
                problems[root / name] = lines
    for name in directory.folders():
        problems[directory.folder_record(name)] = _collect_lines(_folder_problems(directory, name))
    for path in all_unreferenced(directory):
        record = path.with_name(record_of(path.name) or path.name)
        if record != path and not exists(record) and (path.suffix != ".zarr" or _lacks_record(directory, record)):
            problems[record] = [f"the record of {path.name} is missing: a run was killed, or it was deleted; run its stage again"]
    return problems


def _lacks_record(directory: DataDirectory, record: Location) -> bool:
    """Check whether a record is missing: other artifacts have this shard. Withdrawn shards, and other numbers of shards, leave none."""
    same_number = record.stem.endswith(f"-of-{directory.shards() or 0:04d}")
    return same_number and any(exists(directory.root / name / record.name) for name in ARTIFACTS)


def _collect_lines(check: Iterator[str]) -> list[str]:
    """List the lines of a check, and the error that ended it."""
    lines: list[str] = []
    try:
        for line in check:
            lines.append(line)
    except StoreError as error:
        lines.append(str(error))
    return lines


def problems_of(shard: Shard) -> list[str]:
    """Check a shard: first its structure; if that is right, every value against its digest."""
    return _collect_lines(_shard_problems(shard))


def _shard_problems(shard: Shard) -> Iterator[str]:
    shard.attributes  # noqa: B018 (an error where the group's metadata cannot be read)
    with shard.errors_as_damage("metadata cannot be read"):
        violations = list(schema_violations(shard.artifact, shard.described()))
    if violations:
        yield from (f"{line}; {shard.remedy}" for line in violations)
        return
    shard.check_arrays()
    declared = shard.artifact.arrays
    constants = {name: shard.read(name) for name in declared if shard.has(name) and not declared[name].per_object}
    if digest.of_arrays(constants) != shard.record.constants_digest:
        yield f"{', '.join(constants)}: differs from what was written (digest); {shard.remedy}"
    common = {name: shard.read(name) for name in COMMON}
    for position, row in enumerate(shard.record.rows):
        yield from _row_problems(shard, row, {name: values[position] for name, values in common.items()})


def _row_problems(shard: Shard, row: RowRecord, common: dict[str, object]) -> Iterator[str]:
    for name, value in row.labels().items():
        if common[name] != value:
            yield f"{name}: {row.object_id} has {common[name]!r}, its record says {value!r}; {shard.remedy}"
    view = RowView(shard, row.object_id)
    names = set(view)
    for name, array in shard.artifact.ragged.items() if row.failure is None else ():
        if "*" not in name and not array.optional and name not in names:
            yield f"{name}: the array of {row.object_id} is missing; {shard.remedy}"
            return
    for name, value in view.verify().items():
        declared = shard.artifact.of(name)
        if declared is not None and not are_valid(declared, value):
            yield f"{name}: {row.object_id} holds {'NaN' if np.isnan(value).any() else 'an infinite value'}; {shard.remedy}"


def _origin_problems(directory: DataDirectory, name: str) -> Iterator[str]:
    """Check that the shards of an artifact belong together, and were made from the current inputs."""
    collection = directory.collection(ARTIFACTS[name])
    collection.first  # noqa: B018 (an error where shards were made with different settings, scenes or sensors)
    if lacking := list(collection.missing):
        stage = collection.first.record.stage
        yield f"{pluralise(len(lacking))} of the manifest not made yet ({abbreviate(lacking)}); run {stage} without --object"
    for origin in {origin for shard in collection.shards for row in shard.record.rows for origin in row.inputs}:
        if missing := [object_id for object_id in directory.collection(ARTIFACTS[origin]) if object_id not in collection]:
            yield f"{pluralise(len(missing))} of {origin} missing, {missing[0]} first; run {collection.first.record.stage}"
    check_origins(directory, [name])


def _mixed_processors(directory: DataDirectory, name: str) -> Iterator[str]:
    """Check that one kind of processor computed all rows of an artifact."""
    collection = directory.collection(ARTIFACTS[name])
    kinds = collection.processors().most_common()
    if len(kinds) > 1:
        counted = "; ".join(f"{kind}: {pluralise(count, 'row')}" for kind, count in kinds)
        yield (
            f"its rows were computed by {len(kinds)} kinds of processors ({counted}), between which last bits may differ; "
            f"where that matters, delete {collection.folder} and run {collection.first.record.stage} on one kind"
        )


def _folder_problems(directory: DataDirectory, name: str) -> Iterator[str]:
    """Check that a folder holds the files of its record, and was made from the current inputs."""
    yield from directory.folder_problems(name)
    record = directory.folder(name)
    unrecorded = set(files_of(directory.folder_path(name))) - record.files.keys()
    yield from (f"{file} was not written by {made_by(name, record)}" for file in sorted(unrecorded))
    check_origins(directory, [name])


def check_origins(directory: DataDirectory, names: Iterable[str], objects: Container[str] | None = None) -> None:
    """Check that artifacts and folders, and all that they were made from, were made from the current inputs.

    With `objects`, check the rows of these alone: their shards may be remade before others. By default check all, which
    must belong together.
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
