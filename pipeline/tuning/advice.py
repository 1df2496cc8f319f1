"""Which settings fit a time or an error: chosen among measured ones (`pipeline.tuning.tradeoff`), with times as this machine takes them."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.errors import AdviceError
from pipeline.tuning.tradeoff import Point, Trade, assigned

_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class Pace:
    """How fast this machine is at a stage.

    Attributes
    ----------
    factor
        Its seconds over those that were measured.
    start
        Seconds a run beside its objects.
    packing
        Seconds a kilobyte of output, which workers do not share: rows are packed by one process once all are made.
    """

    factor: float = 1.0
    start: float = 0.0
    packing: float = 0.0


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


@dataclass(frozen=True)
class Limit:
    """An error that is not to be passed: of a stage, or of the one stage that is measured in its unit."""

    value: float
    unit: str
    stage: str | None = None

    def is_on(self, trade: Trade) -> bool:
        """Whether it is a limit on this stage's error."""
        return self.unit == trade.unit if self.stage is None else self.stage == trade.stage


def error_limit(text: str) -> Limit:
    """The limit that "5um", "2%" or "fit-charts=200um" says; an `AdviceError` at anything else."""
    match = re.fullmatch(r"(?:([a-z-]+) *= *)?([0-9.]+(?:[eE][-+]?[0-9]+)?) *([^0-9. ].*)?", text.strip())
    if not match or (value := _number(match[2])) is None or not (match[1] or match[3]):
        raise AdviceError(f"{text!r} is no error; write a number and the unit it is measured in, as 5um, 2% or fit-charts=200um")
    return Limit(value, (match[3] or "").replace("µm", "um"), match[1])


def within_time(
    trades: Sequence[Trade], paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int, seconds: float
) -> list[Choice]:
    """Of every stage one setting, all together within a time, so that the product of their bounds is least.

    `objects` are how many each stage has to do with, `workers` the processes that share them where they are done one by one.
    Bounds have units of their own, so they are compared by ratios: to halve one counts as much as to halve another.

    Raises
    ------
    AdviceError
        The cheapest settings take longer: with how long.
    """
    plans: list[_Plan] = [(0.0, 0.0, ())]
    for trade in trades:
        options = [_choice(trade, point, paces, objects, workers) for point in trade.front()]
        plans = _undominated(
            [(t + one.seconds, e + _log_bound(one), (*row, one)) for (t, e, row), one in itertools.product(plans, options)]
        )
    if plans[0][0] > seconds:
        raise AdviceError(f"the fastest measured settings take {plans[0][0]:.0f} s, {seconds:.0f} s were given; take fewer objects")
    return list([plan for plan in plans if plan[0] <= seconds][-1][2])  # the slowest of them is the most accurate


def fastest(trades: Sequence[Trade], paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int) -> list[Choice]:
    """Of every stage the setting that takes least time."""
    return [
        min((_choice(trade, point, paces, objects, workers) for point in trade.front()), key=lambda one: one.seconds) for trade in trades
    ]


def within_error(
    trades: Sequence[Trade], paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int, limit: Limit, otherwise: str
) -> list[Choice]:
    """Of the stage that the limit is on the fastest setting whose bound is within it, of the others the preset `otherwise`.

    Raises
    ------
    AdviceError
        The limit is on no stage or on several, or no setting is accurate enough: with the best there is.
    """
    limited = [trade for trade in trades if limit.is_on(trade)]
    if len(limited) != 1:
        measured = ", ".join(f"{trade.stage} in {trade.unit or 'a number without unit'}" for trade in trades)
        if limit.stage is not None:
            raise AdviceError(f"settings are not chosen for {limit.stage} here, but for {measured}")
        raise AdviceError(f"{'several stages are' if limited else 'no stage is'} measured so; say which, as STAGE=5um: {measured}")
    (stage,) = limited
    if limit.unit != stage.unit:
        raise AdviceError(f"{stage.stage} is measured in {stage.unit or 'a number without unit'}: {stage.metric}")
    fits = [point for point in stage.choices if point.bound <= limit.value]
    if not fits:
        best = min(point.bound for point in stage.choices)
        raise AdviceError(f"{stage.name}: {stage.metric}, stays below {best:.3g} at best, 19 times in 20, not {limit.value:g}")
    chosen = []
    for trade in trades:
        candidates = fits if trade is stage else [point for point in trade.points if point.is_preset(otherwise)]
        row = [_choice(trade, point, paces, objects, workers) for point in candidates]
        chosen.append(min(row, key=lambda choice: (round(choice.seconds, 1), choice.point.kilobytes, choice.point.bound)))
    return chosen


def assignments(choice: Choice, standing: Mapping[str, object]) -> list[str]:
    """What `--set` has to say for a choice where the settings stand otherwise as given."""
    changed = {setting: value for setting, value in choice.point.settings.items() if standing[setting] != value}
    return [f"{choice.trade.stage}.{assigned(setting, value)}" for setting, value in changed.items()]


_Plan = tuple[float, float, tuple[Choice, ...]]
"""Seconds, logarithm of the product of bounds, and the settings of some stages."""


def _undominated(plans: list[_Plan]) -> list[_Plan]:
    """Those than which none is both faster and more accurate, the fastest first."""
    kept: list[_Plan] = []
    for plan in sorted(plans, key=lambda plan: plan[:2]):
        if not kept or plan[1] < kept[-1][1]:
            kept.append(plan)
    return kept


def _choice(trade: Trade, point: Point, paces: Mapping[str, Pace], objects: Mapping[str, int], workers: int) -> Choice:
    pace, count = paces.get(trade.stage, Pace()), objects[trade.stage]
    share = count / trade.objects if trade.whole else math.ceil(count / workers)
    packed = 0.0 if trade.whole else count * point.kilobytes * pace.packing
    return Choice(trade, point, pace.start + share * point.seconds * pace.factor + packed)


def _log_bound(choice: Choice) -> float:
    """A bound of zero says that others are measured against this setting: it counts as the smallest above zero."""
    return math.log(choice.point.bound or min((point.bound for point in choice.trade.points if point.bound > 0), default=1.0))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
