"""Which settings fit a time or an error: chosen among measured ones (`pipeline.tradeoff`), with times as this machine takes them."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.tradeoff import Point, Trade

LEAST_SHARE = 0.1
"""Of the smallest error measured above zero: what an error of zero counts as where errors are compared by their ratio."""
_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


class AdviceError(ValueError):
    """No measured setting does what is asked; the message says what the nearest one does."""


@dataclass(frozen=True)
class Pace:
    """How fast this machine is at a stage: its seconds over those that were measured, and seconds a run beside the objects."""

    factor: float = 1.0
    start: float = 0.0


@dataclass(frozen=True)
class Choice:
    """A setting for a stage, and how long it takes for all objects here, s."""

    trade: Trade
    point: Point
    seconds: float


def duration(text: str) -> float:
    """Seconds of "90s", "10min" or "1.5h"; an `AdviceError` at anything else."""
    match = re.fullmatch(r"([0-9.]+) *(s|min|h)", text.strip())
    if not match or (value := _number(match[1])) is None or value <= 0:
        raise AdviceError(f"{text!r} is no time; write 90s, 10min or 1.5h")
    return value * _UNITS[match[2]]


def error_limit(text: str) -> tuple[float, str]:
    """Value and unit of "5um" or "2%"; an `AdviceError` at anything else."""
    match = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?) *([^0-9. ].*)", text.strip())
    if not match or (value := _number(match[1])) is None:
        raise AdviceError(f"{text!r} is no error; write a number and the unit it is measured in, as 5um or 2%")
    return value, match[2].replace("µm", "um")


def within_time(
    trades: Sequence[Trade], paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int, seconds: float
) -> list[Choice]:
    """Of every stage one setting, all together within a time, so that the product of their errors is least.

    `objects` are how many each stage has to do with, `workers` the processes that share them where they are done one by one.
    Errors have units of their own, so they are compared by ratios: to halve one counts as much as to halve another.

    Raises
    ------
    AdviceError
        The cheapest settings take longer: with how long.
    """
    plans: list[_Plan] = [(0.0, 0.0, ())]
    for trade in trades:
        options = [_choice(trade, point, paces, objects, workers) for point in trade.front()]
        plans = _undominated(
            [(t + one.seconds, e + _log_error(one), (*row, one)) for (t, e, row), one in itertools.product(plans, options)]
        )
    if plans[0][0] > seconds:
        raise AdviceError(f"the fastest measured settings take {plans[0][0]:.0f} s, {seconds:.0f} s were given; take fewer objects")
    return list([plan for plan in plans if plan[0] <= seconds][-1][2])  # the slowest of them is the most accurate


def within_error(
    trades: Sequence[Trade], paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int, limit: float, unit: str, otherwise: str
) -> list[Choice]:
    """Of every stage whose error is measured in `unit` the fastest setting whose bound is within the limit, else the preset `otherwise`.

    Raises
    ------
    AdviceError
        No stage is measured in that unit, or one has no setting that is accurate enough: with the best there is.
    """
    if unit not in (units := sorted({trade.unit for trade in trades})):
        raise AdviceError(f"no stage's error is measured in {unit}; there are {', '.join(units)}")
    chosen = []
    for trade in trades:
        if trade.unit == unit and not (fits := [point for point in trade.choices if point.bound <= limit]):
            raise AdviceError(f"{trade.name}: {trade.metric}, is {min(point.bound for point in trade.choices):.3g} at best, not {limit:g}")
        candidates = fits if trade.unit == unit else [point for point in trade.points if point.is_preset(otherwise)]
        row = [_choice(trade, point, paces, objects, workers) for point in candidates]
        chosen.append(min(row, key=lambda choice: (round(choice.seconds, 1), choice.point.kilobytes, choice.point.error)))
    return chosen


def assignments(choice: Choice, standing: Mapping[str, object]) -> list[str]:
    """What `--set` has to say for a choice where the knobs stand otherwise as given."""
    changed = {knob: value for knob, value in choice.point.settings.items() if standing[knob] != value}
    return [f"{choice.trade.stage}.{knob}={'null' if value is None else str(value).lower()}" for knob, value in changed.items()]


_Plan = tuple[float, float, tuple[Choice, ...]]
"""Seconds, logarithm of the product of errors, and the settings of some stages."""


def _undominated(plans: list[_Plan]) -> list[_Plan]:
    """Those than which none is both faster and more accurate, the fastest first."""
    kept: list[_Plan] = []
    for plan in sorted(plans, key=lambda plan: plan[:2]):
        if not kept or plan[1] < kept[-1][1]:
            kept.append(plan)
    return kept


def _choice(trade: Trade, point: Point, paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int) -> Choice:
    pace, count = paces.get(trade.stage, Pace()), objects[trade.stage]
    share = count / trade.objects if trade.whole else count / workers
    return Choice(trade, point, pace.start + share * point.seconds * pace.factor)


def _log_error(choice: Choice) -> float:
    least = min((point.error for point in choice.trade.points if point.error > 0), default=1.0)
    return math.log(max(choice.point.error, LEAST_SHARE * least))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
