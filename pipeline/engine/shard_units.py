"""The state of a shard's units: which are finished, published, pending or failed."""

from pipeline.engine.plan import Plan
from pipeline.engine.unit import Unit
from pipeline.store.publish import ShardOutput
from pipeline.store.record import Failure, RowRecord
from pipeline.store.row_files import Result
from pipeline.store.rows import row_digest


def finished(plan: Plan[ShardOutput], unit: Unit) -> Result | None:
    """Find the result of a unit that waits to be published; None if there is none yet."""
    if unit.failure:
        return Result(name=unit.name, key=unit.key, digest=row_digest({}, unit.failure, unit.category), failure=unit.failure)
    return plan.output.rows.find(unit.name, unit.key)


def published(plan: Plan[ShardOutput], unit: Unit) -> RowRecord | None:
    """Find the published row of a unit; None if there is none with its key."""
    shard = plan.output.shard
    row = shard.row(unit.name) if shard and unit.name in shard.position else None
    return row if row is not None and row.key == unit.key else None


def reusable(plan: Plan[ShardOutput], unit: Unit) -> RowRecord | None:
    """Find the published row of a unit, unless it failed and is retried."""
    row = published(plan, unit)
    return None if row is not None and plan.failed_here(row.failure) and plan.is_retried(unit.name) else row


def requested_units(plan: Plan[ShardOutput]) -> list[Unit]:
    """List the units of a run: all of the shard, or with `only` the one."""
    return [unit for unit in plan.units if plan.request.only in (None, unit.name)]


def pending_units(plan: Plan[ShardOutput]) -> list[Unit]:
    """List the requested units without a row, published or waiting to be, under their key, and those to retry."""
    return [unit for unit in requested_units(plan) if not is_settled(plan, unit, finished(plan, unit)) and reusable(plan, unit) is None]


def is_settled(plan: Plan[ShardOutput], unit: Unit, result: Result | None) -> bool:
    """Check whether a result waits to be published, and is no failure to retry."""
    return result is not None and (unit.failure is not None or result.failure is None or not plan.is_retried(unit.name))


def failures(plan: Plan[ShardOutput]) -> dict[str, Failure]:
    """List the requested objects that failed under this stage's current key, published or not, with their reasons."""
    failed: dict[str, Failure] = {}
    for unit in requested_units(plan):
        state = finished(plan, unit) or published(plan, unit)
        if state and state.failure and plan.failed_here(state.failure):
            failed[unit.name] = state.failure
    return failed


def failures_before(plan: Plan[ShardOutput]) -> int:
    """Count the requested objects that failed in an earlier stage."""
    return sum(unit.failure is not None and not plan.failed_here(unit.failure) for unit in requested_units(plan))
