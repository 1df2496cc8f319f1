"""Measured trades, as `DATA/tradeoff/STAGE.json` holds them, and choices among their settings for a time or an error."""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import ValidationError

from pipeline.config.settings import Settings
from pipeline.entries import Entries
from pipeline.errors import InvalidInput, StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.rng import numpy_rng
from pipeline.store.atomic import write_atomically
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS
from stages.registry import assignment

FOLDER = "tradeoff"  # folder of the measurements, below a data directory
CONFIDENCE = 0.998  # of Student's t for a bound: 19 of 20 other samples keep it even with skewed errors, as lognormal ones of σ = 0.8
END_TO_END = "reconstruction"  # the name, in place of a stage's, under which the trade of whole datasets is kept


NUMBER = r"([0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?|\.[0-9]+)"
DURATIONS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}


class Point(Entries):
    """A setting that was measured."""

    label: str  # its presets, or what differs from the user's own settings
    changes: dict[str, Any]  # the settings that differ from the user's own, by name
    presets: tuple[str, ...] = ()  # that have these settings
    # s on one core: by object, or one figure: per object if a stage processes all at once, of all for datasets
    times: dict[str, float]
    kilobytes: float  # on disk, likewise
    errors: dict[str, tuple[float, ...]]  # by object, one per training

    @property
    def seconds(self) -> float:
        """The mean of the times."""
        return float(np.mean(list(self.times.values())))

    @property
    def error(self) -> float:
        """The mean over objects."""
        return float(self._table.mean())

    @cached_property
    def interval(self) -> Interval:
        """The mean with its 95 % bootstrap interval over objects and trainings."""
        return mean_interval(self._table, numpy_rng(0, "tradeoff", self.label))

    @property
    def _table(self) -> NDArray[np.float64]:
        """(trainings, objects) errors."""
        return np.array(list(self.errors.values()), np.float64).T

    def bound(self, objects: int, trials: int = 0) -> float:
        """Bound the mean error of other objects, with confidence `CONFIDENCE`.

        `trials` is the number of trials per object of which the error is a share, %; 0 if it is no share.
        This is Student's bound of the difference of two sample means; of shares at least the rule of three's, for
        samples without failures.
        """
        values = self._table.mean(axis=0)
        if len(values) < 2:
            return np.inf
        spread = float(values.std(ddof=1)) * np.sqrt(1 / len(values) + 1 / objects)
        smallest = 300 / (trials * min(len(values), objects)) if trials else 0.0
        return max(float(values.mean() + scipy.stats.t.ppf(CONFIDENCE, len(values) - 1) * spread), smallest)


class MeasuredTrade(Entries):
    """The trade of a stage."""

    stage: str
    metric: str
    unit: str  # of the errors
    cost: str = "seconds per object, one core"  # what the times measure
    key: str  # hash of what the figures depend on beside sample and machine (`measure.stage_key`)
    preset: str  # with `assignments`: the user's settings, which points change
    assignments: tuple[str, ...]
    objects: tuple[str, ...]  # ids of the sample
    sample: str  # hash of their categories, splits and sources
    trained: int  # how many of them a stage learns from, if it processes all at once; else 0
    trials: int = 0  # per object, of which the error is a share; 0 if it is no share
    machine: str  # the processor
    total: int  # number of points, once all are measured
    points: tuple[Point, ...] = ()  # those measured so far

    def front(self) -> list[Point]:
        """List the points that no other beats in both time and error, the fastest first."""
        best: list[Point] = []
        for point in sorted(self.points, key=lambda point: (point.seconds, point.error)):
            if not best or point.error < best[-1].error:
                best.append(point)
        return best

    def own(self) -> Point | None:
        """Find the point of the user's settings."""
        return next((point for point in self.points if not point.changes), None)

    def write(self, data: Path) -> None:
        """Write the trade below a data directory."""
        path = trade_path(data, self.stage)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, self.model_dump_json(indent=1).encode())


def trade_path(data: Path, stage: str) -> Path:
    """Name the file of a stage's trade."""
    return data / FOLDER / f"{stage}.json"


def read_trade(data: Path, stage: str) -> MeasuredTrade | None:
    """Read a stage's trade; None if it was not measured."""
    path = trade_path(data, stage)
    if not path.is_file():
        return None
    try:
        return MeasuredTrade.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise StoreError(f"{path} cannot be used ({invalid_entries(error)}); remove it, then run `vt-pipeline tradeoff {stage}`") from error


def kilobytes(data: Path, output: str) -> float:
    """Measure the size of an artifact or a folder of a data directory, without replaced data."""
    directory = DataDirectory(data)
    shards = directory.collection(ARTIFACTS[output]).shards if output in ARTIFACTS else []
    paths = [Path(str(shard.path)) for shard in shards] or [directory.verified_folder(output)]
    return sum(inner.stat().st_size for path in paths for inner in files_of(path)) / 1e3


def times_of(stage: Any, settings: Settings, data: Path, trained: int) -> dict[str, float]:
    """Read the seconds per object from records, of a training its share per object; the first object, a warm-up, counts only if alone."""
    directory, output = DataDirectory(data), stage.writes(settings)
    if trained:
        return {"each": float(directory.folder(output).facts["training_seconds"]) / trained}
    rows = [row for shard in directory.collection(ARTIFACTS[output]).shards for row in shard.record.rows if row.failure is None]
    return {row.object_id: row.seconds for row in rows[1:] or rows}


def files_of(path: Path) -> Iterator[Path]:
    """List a file, or those below a folder."""
    return iter([path]) if path.is_file() else (inner for inner in path.rglob("*") if inner.is_file() and not inner.is_symlink())


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

    Errors have different units, so they are compared by ratios: halving one counts as much as halving another.
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
        raise InvalidInput(f"the fastest settings take {plans[0][0]:.0f} s, {seconds:.0f} s were given; take more cores or fewer objects")
    return list(fitting[-1][2])


def within_error(trades: Sequence[MeasuredTrade], workload: Workload, limit: Limit) -> list[Choice]:
    """Choose the fastest setting of each stage whose error stays within a limit; stages without such an error keep the user's."""
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
