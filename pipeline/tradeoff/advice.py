"""Choose settings for a time or an error, among those that were measured on the user's objects."""

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.errors import InvalidInput
from pipeline.tradeoff.measured import MeasuredTrade, Point
from stages.registry import assignment

NUMBER = r"([0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?|\.[0-9]+)"
DURATIONS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}


@dataclass(frozen=True)
class Workload:
    """The number of objects to make, and of cores."""

    objects: int
    cores: int

    def seconds(self, trade: MeasuredTrade, point: Point) -> float:
        """Predict the seconds of a stage; a training runs on one core, as measured, and its time grows with its training objects."""
        if trade.trained:
            return point.seconds * self.objects * trade.trained / len(trade.objects)
        return point.seconds * math.ceil(self.objects / self.cores)


@dataclass(frozen=True)
class Choice:
    """A measured setting of a stage, its predicted `seconds` for all objects, and the bound of their mean error."""

    trade: MeasuredTrade
    point: Point
    seconds: float
    bound: float

    def assignments(self) -> list[str]:
        """List the differences from the user's settings as `--set` takes them."""
        return [f"{self.trade.stage}.{assignment(name, value)}" for name, value in self.point.changes.items()]


@dataclass(frozen=True)
class Limit:
    """An upper limit on an error: on that of one stage, or on every error of the same kind of unit."""

    value: float
    unit: str
    stage: str | None = None

    def of(self, trade: MeasuredTrade) -> float | None:
        """Convert to the unit of a trade; None where it does not apply."""
        if self.stage not in (None, trade.stage):
            return None
        if self.unit in LENGTHS and trade.unit in LENGTHS:
            return self.value * LENGTHS[self.unit] / LENGTHS[trade.unit]
        return self.value if self.unit == trade.unit else None


def parse_duration(text: str) -> float:
    """Parse a duration, such as "90s", "10min", "1.5h" or "2d", to seconds."""
    match = re.fullmatch(rf"{NUMBER} *(s|min|h|d)", text.strip())
    if not match or not (value := float(match[1])):
        raise InvalidInput(f"{text!r} is not a time; write 90s, 10min, 1.5h or 2d")
    return value * DURATIONS[match[2]]


def parse_limit(text: str) -> Limit:
    """Parse a limit on an error, such as "0.1mm", "5%" or "train-gcn=12"."""
    match = re.fullmatch(rf"(?:([a-z-]+) *= *)?{NUMBER} *([^0-9. ].*)?", text.strip())
    if not match or not (match[1] or match[3]):
        raise InvalidInput(f"{text!r} is not an error; write a number and its unit, as 0.1mm, 5% or train-gcn=12")
    return Limit(float(match[2]), match[3] or "", match[1])


def choices(trade: MeasuredTrade, workload: Workload) -> list[Choice]:
    """Predict the time and the bound of every measured setting of a stage."""
    chosen = []
    for point in trade.points:
        objects = max(1, round(workload.objects * len(point.errors) / len(trade.objects)))  # of trainings, only test objects have errors
        chosen.append(Choice(trade, point, workload.seconds(trade, point), point.bound(objects, trade.trials)))
    return chosen


def within_time(trades: Sequence[MeasuredTrade], workload: Workload, seconds: float) -> list[Choice]:
    """Choose one setting per stage such that all fit within a time, s, and the product of the error bounds is least.

    Errors have different units, so they are compared by ratios: halving one counts as much as halving another. If even
    the fastest settings take longer, an `InvalidInput` says how long.
    """
    plans: list[tuple[float, float, tuple[Choice, ...]]] = [(0.0, 0.0, ())]  # seconds, logarithm of the product, choices
    for trade in trades:
        options = choices(trade, workload)
        # stands for a bound of 0, that of the reference
        floor = min((option.bound for option in options if option.bound > 0), default=1.0)
        longer = [
            (t + option.seconds, e + math.log(option.bound or floor), (*selected, option))
            for (t, e, selected), option in itertools.product(plans, options)
        ]
        plans = []
        for plan in sorted(longer, key=lambda plan: plan[:2]):
            if not plans or plan[1] < plans[-1][1]:  # no other is both faster and more accurate
                plans.append(plan)
    fitting = [plan for plan in plans if plan[0] <= seconds]
    if not fitting:
        raise InvalidInput(
            f"the fastest measured settings take {plans[0][0]:.0f} s, {seconds:.0f} s were given; take more cores or fewer objects"
        )
    return list(fitting[-1][2])


def within_error(trades: Sequence[MeasuredTrade], workload: Workload, limit: Limit) -> list[Choice]:
    """Choose the fastest setting of each stage whose error stays within a limit.

    Stages without such an error keep the user's. If no setting keeps the limit, or no measured error has it, an
    `InvalidInput` lists the measured errors.
    """
    if all(limit.of(trade) is None for trade in trades):
        units = ", ".join(f"{trade.stage} in {trade.unit or 'a number without unit'}" for trade in trades)
        raise InvalidInput(f"no error is measured so; there are {units}")
    selected = []
    for trade in trades:
        options, bound = choices(trade, workload), limit.of(trade)
        if bound is None:
            fitting = [option for option in options if not option.point.changes]
            problem = "your own settings were not measured, for lack of time; give `vt-pipeline tradeoff` more"
        else:
            fitting, best = [option for option in options if option.bound <= bound], min(option.bound for option in options)
            problem = (
                f"{trade.metric}: at best {best:.3g} {trade.unit} is kept to, not {bound:g}; allow a larger error, or measure more "
                "accurate settings: `vt-pipeline tradeoff` with another --preset or --set"
            )
        if not fitting:
            raise InvalidInput(f"{trade.stage}: {problem}")
        selected.append(min(fitting, key=lambda option: (option.seconds, option.bound)))
    return selected
