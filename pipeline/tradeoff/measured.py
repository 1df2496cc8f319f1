"""Measured trades, as `DATA/tradeoff/STAGE.json` holds them, and the times and sizes that records show."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.stats import t as student

from pipeline.config.settings import Settings
from pipeline.entries import Entries
from pipeline.errors import StoreError
from pipeline.formats.description_file import invalid_entries
from pipeline.kernels.metrics.bootstrap import Interval, mean_interval
from pipeline.rng import numpy_rng
from pipeline.store.atomic import write_atomically
from pipeline.store.directory import DataDirectory
from schemas.catalogue import ARTIFACTS

FOLDER = "tradeoff"
"""Folder of the measurements, below a data directory."""
CONFIDENCE = 0.998
"""Confidence of Student's t for a bound: 19 of 20 other samples keep it even with skewed errors, such as lognormal ones of σ = 0.8."""


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
        return max(float(values.mean() + student.ppf(CONFIDENCE, len(values) - 1) * spread), smallest)


class MeasuredTrade(Entries):
    """The trade of a stage."""

    stage: str
    metric: str
    unit: str  # of the errors
    cost: str = "seconds per object, one core"  # what the times measure
    key: str  # hash of what the figures depend on beside sample and machine (`measure.trade_key`)
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
