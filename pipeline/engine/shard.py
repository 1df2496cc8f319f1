"""Shards: a plan with a unit per object, made by an executor, then published as one group."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, cast

from rich.console import Console

from pipeline.config.manifest import Object
from pipeline.config.settings import ObjectSettings
from pipeline.console import Meter, abbreviate, pluralise
from pipeline.engine import keys
from pipeline.engine.plan import Forecast, Plan, Request, Summary, description_errors
from pipeline.engine.session import Work, check_assets
from pipeline.engine.shard_units import failures, failures_before, finished, is_settled, pending_units, requested_units, reusable
from pipeline.engine.stage import ObjectStage, names_read
from pipeline.engine.unit import Unit
from pipeline.errors import BugFound, InvalidInput, StageError, StoreError
from pipeline.store import digest
from pipeline.store.collection import Collection
from pipeline.store.directory import DataDirectory, shard_of
from pipeline.store.origins import check_origins
from pipeline.store.publish import ShardOutput, withdraw
from pipeline.store.record import Failure, RowRecord, ShardRecord
from pipeline.store.row_files import Result
from pipeline.store.rows import Row, conform
from pipeline.store.storage import exists


def plan_shard(request: Request[Any], directory: DataDirectory, number: int, shards: int) -> Plan[ShardOutput]:
    """Plan a shard of an object stage; with `only`, of this object and those that are already published.

    All plans of a run share a directory: the records of inputs are read once. A `StoreError` says that an input has not
    been made, or not from the current inputs; an `InvalidInput`, that the shard is of another manifest, with objects
    that this one lacks.
    """
    stage: ObjectStage = request.stage
    output = ShardOutput(directory, stage.output, number, shards)
    plan = Plan(request, directory, output, (stage.output.name, stage.output.version))
    items = [item for item in request.objects if shard_of(item.object_id, shards) == number]
    plan.total = len(items)
    _check_same_manifest(request, output)
    if request.only is not None:
        included = {request.only, *(output.shard.position if output.shard else ())}
        plan.missing = tuple(item.object_id for item in items if item.object_id not in included)
        items = [item for item in items if item.object_id in included]
    check_origins(directory, names_read(stage, plan.settings), {item.object_id for item in items})
    if items:  # a shard without objects reads nothing, whether or not its inputs have been made
        # the rows of a shard come from those of the same number
        roots = {collection.artifact.name: collection.shard(items[0].object_id).attributes for collection in plan.inputs}
        with description_errors(stage):
            plan.settings = stage.resolve_settings(plan.settings, roots)
            stage.check_inputs(plan.settings, roots)
    plan.units = [_unit(plan, item) for item in items]
    rows = ((unit.key, unit.split) for unit in plan.units)
    plan.key = keys.shard_key(rows, number, shards, request.manifest, plan.missing, _labels(plan) if items else None)
    return plan


def _unit(plan: Plan[ShardOutput], item: Object) -> Unit:
    """Plan an object's row, from its source or from its rows of the inputs."""
    inputs: dict[str, str] = {}
    failure: Failure | None = None
    origin: dict[str, Any] = inputs
    if plan.inputs:
        for collection in plan.inputs:
            row = collection.row(item.object_id)
            inputs[collection.artifact.name] = row.digest
            failure = failure or row.failure
        if files := [path for path in plan.stage.files(item.source) if path.is_file()]:  # the stage reports a missing one
            origin = {**inputs, "files": keys.assets_digest(files)}
    else:
        try:
            origin = {"source": keys.source_key(item.source)}
        except (OSError, InvalidInput) as error:
            origin = {"unreadable": str(error)}
            failure = Failure(stage=plan.stage.name, reason=f"its file cannot be read: {error}; mend or remove it")
    key = keys.object_key(plan.stage_key, item.object_id, item.category, origin)
    return Unit(item.object_id, key, inputs, plan.request.seed, item.category, item.split, item.source, failure)


def published_collection(plan: Plan[ShardOutput]) -> Collection:
    """Open all shards of the artifact; none if one is damaged or of another version, and must be made again."""
    try:
        return plan.directory.collection(plan.output.artifact)
    except StoreError:
        return Collection(plan.path.parent, plan.output.artifact, [])


def forecast_shard(plan: Plan[ShardOutput]) -> Forecast:
    """Estimate a run from the seconds that objects took before, else from the stage's own estimate."""
    cost, up_to_date = plan.stage.cost(plan.settings), plan.up_to_date()
    number = 0 if up_to_date else len(pending_units(plan))
    same = [shard for shard in published_collection(plan).shards if shard.record.settings == plan.settings.results()]
    seconds = [row.seconds for shard in same for row in shard.record.rows]
    mean = sum(seconds) / len(seconds) if seconds else cost.seconds
    return Forecast(
        number,
        len(plan.units) if up_to_date else plan.total,
        number * mean / plan.request.executor.processes,
        plan.total * cost.kilobytes,
        up_to_date,
        failed=len(failures(plan)) if up_to_date else 0,
        failed_before=failures_before(plan) if up_to_date else 0,
    )


# ---- processing and publishing


def make_shard(plan: Plan[ShardOutput], console: Console) -> Summary:
    """Process pending units, then publish.

    With `only`, nothing is published if readers would lose a row that must be made again first, or that cannot be read.
    A shard without objects is withdrawn.
    """
    plan.directory.set_shard_count(plan.output.shards)
    _check_shared_objects(plan)
    if not plan.units:  # all its objects are gone
        withdraw(plan.output.record_path)
        return Summary()
    results: dict[str, Result] = {}
    for unit in plan.units:
        if result := _reuse(plan, unit):
            _check_strictness(plan, result)
            results[unit.name] = result
    pending = [unit for unit in requested_units(plan) if unit.name not in results]
    began = time.perf_counter()
    made = 0
    for result in _process(plan, pending, console):
        results[result.name] = result
        made += result.failure is None
    summary = Summary(made, time.perf_counter() - began)
    if plan.request.only is not None and _loses_rows(plan, results):
        return replace(summary, held_back=True)
    _publish(plan, [results[unit.name] for unit in plan.units])
    return summary


def _loses_rows(plan: Plan[ShardOutput], results: Mapping[str, Result]) -> bool:
    """Check whether readers would lose a published row if these results were published."""
    if plan.output.shard is None:
        return exists(plan.output.record_path)
    return not plan.output.shard.position.keys() <= results.keys()


def _check_same_manifest(request: Request[Any], output: ShardOutput) -> None:
    """Refuse to overwrite objects that the manifest lacks: it may be forgotten."""
    record = output.record
    if record is not None and record.manifest != request.manifest:
        named = {item.object_id for item in request.objects}
        if lost := [row.object_id for row in record.rows if row.object_id not in named]:
            raise InvalidInput(
                f"{output.path} is of manifest {record.manifest}; {request.manifest} lacks {pluralise(len(lost))} of it "
                f"({abbreviate(lost)}); name that --manifest (make: MANIFEST=), or another --data (make: DATA=)"
            )


def _check_shared_objects(plan: Plan[ShardOutput]) -> None:
    """Refuse to overwrite other objects: two folders of meshes may have one name."""
    request, existing = plan.request, published_collection(plan)
    if len(existing) and not any(item.object_id in existing for item in request.objects):
        raise StoreError(
            f"{plan.path.parent} holds other objects ({abbreviate(list(existing))}), and none of manifest "
            f"{request.manifest}; name another --data (make: DATA=), or delete it"
        )


def _reuse(plan: Plan[ShardOutput], unit: Unit) -> Result | None:
    """Find a row to reuse: one that waits, or the published one, unless it is damaged."""
    result = finished(plan, unit)
    if result and not is_settled(plan, unit, result):
        plan.output.rows.discard(unit.name, unit.key)
        result = None
    shard, row = plan.output.shard, reusable(plan, unit)
    if result or row is None or shard is None:
        return result
    with suppress(StoreError):
        reused = Result(name=unit.name, key=unit.key, seconds=row.seconds, processor=shard.record.processor_of(row), failure=row.failure)
        return plan.output.rows.save(reused, shard.view(unit.name).verify(), unit.category)
    return None


def _process(plan: Plan[ShardOutput], units: list[Unit], console: Console) -> Iterator[Result]:
    """Process units; raise a bug in one of them, or the change of a file, at the end, when the others are done."""
    work = Work(plan.stage, cast(ObjectSettings, plan.settings), plan.request.data, plan.model_digests, plan.assets)
    bugs, changed, planned = [], [], {unit.name: unit for unit in units}
    with Meter(console, plan.stage.name, len(units), "objects") as meter:
        for result in plan.request.executor.run(work, units) if units else ():
            meter.advance()
            if result.bug:
                bugs.append(result)
            elif _source_changed(plan, planned[result.name]):
                plan.output.rows.discard(result.name, result.key)
                changed.append(result.name)
            else:
                _check_strictness(plan, result)
            yield result
    if bugs:
        raise BugFound(
            f"{plan.stage.name}: processing {', '.join(result.name for result in bugs)} met a bug in vt-pipeline, not a fault "
            f"of the objects. Please report it with this traceback; to continue, leave the objects out of the manifest.\n{bugs[0].bug}"
        )
    if changed:
        raise StageError(f"{plan.stage.name}: files of {abbreviate(changed)} changed meanwhile; run again: what is finished is kept")


def _source_changed(plan: Plan[ShardOutput], unit: Unit) -> bool:
    """Check whether a file of an object is no longer the one in its key: its row may be of either."""
    return _unit(plan, Object(unit.name, unit.category, dict(unit.source), unit.split)).key != unit.key


def _check_strictness(plan: Plan[ShardOutput], result: Result) -> None:
    if plan.request.strict and result.failure and plan.failed_here(result.failure) and plan.request.only in (None, result.name):
        raise InvalidInput(f"{result.name}: {result.failure.reason} (--strict stops here; without it the others go on)")


def _publish(plan: Plan[ShardOutput], results: list[Result]) -> None:
    stage, output = plan.stage, plan.output
    rows = [
        RowRecord(
            object_id=unit.name,
            category=unit.category,
            split=unit.split,
            key=unit.key,
            digest=result.digest,
            inputs=unit.inputs,
            seconds=round(result.seconds, 4),
            processor=result.processor,
            failure=result.failure,
        )
        for unit, result in zip(plan.units, results, strict=True)
    ]
    attributes = {
        "schema": output.artifact.name,
        "schema_version": output.artifact.version,
        "stage": stage.name,
        "settings": plan.settings.results(),
        "seed": plan.request.seed,
        "manifest": plan.request.manifest,
        "failures": {row.object_id: row.failure.model_dump() for row in rows if row.failure},
        **stage.attributes(plan.settings),
    }
    constants = conform(output.artifact, _labels(plan) | stage.constants(plan.settings), constants=True)
    check_assets(stage, plan.settings, plan.assets)  # attributes and constants were read just now
    record = ShardRecord(
        **plan.provenance(),
        schema_version=output.artifact.version,
        rows=tuple(rows),
        missing=plan.missing,
        constants_digest=digest.of_arrays(constants),
        metadata={},
    )
    output.commit(record, [result.shapes for result in results], lambda number: output.rows.chunks(results[number]), constants, attributes)
    output.rows.discard_all({unit.name: unit.key for unit in plan.units})


def _labels(plan: Plan[ShardOutput]) -> Row:
    """Read the labels of dimensions from the inputs' shards of the same number: others may be out of date."""
    labels: Row = {}
    for collection in plan.inputs:
        shard = collection.shard(plan.units[0].name)
        for name, array in plan.output.artifact.arrays.items():
            if array.is_coordinate and shard.has(name):
                labels[name] = shard.read(name)
    return labels
