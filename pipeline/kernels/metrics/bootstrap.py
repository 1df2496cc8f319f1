"""Bootstrap intervals of means over objects and trainings, paired where two configurations have the same objects."""

from dataclasses import dataclass

import numpy as np

from pipeline.kernels.arrays import Array

RESAMPLES = 10_000  # means drawn for an interval: its ends vary by about a hundredth of its length from seed to seed
LEVEL = 0.95  # share of the resampled means that an interval holds
BATCH = 1000  # resamples held in memory at a time


@dataclass(frozen=True)
class Interval:
    """A mean, and the ends of its interval, in the values' unit; the ends are infinite for a single object."""

    mean: float
    low: float
    high: float
    count: int  # objects that the mean is of

    def __format__(self, form: str) -> str:
        ends = f"\n({self.low:{form}}–{self.high:{form}})" if np.isfinite([self.low, self.high]).all() else ""
        return f"{self.mean:{form}}{ends}"

    def signed(self, form: str) -> str:
        """Write a difference and its ends with their signs."""
        ends = f" ({self.low:+{form}} to {self.high:+{form}})" if np.isfinite([self.low, self.high]).all() else ""
        return f"{self.mean:+{form}}{ends}"


def mean_interval(values: Array, rng: np.random.Generator) -> Interval:
    """Compute a mean over objects, (N,), and trainings, (S, N), with its 95 % percentile bootstrap interval.

    Objects and trainings are drawn with replacement, independently of each other (the pigeonhole bootstrap; Owen, 2007). With few of
    either, the interval is too short: of 5 objects its true coverage is about 80 % instead of 95 %, and of S trainings it contains
    (S - 1) / S of the variance between them: none of a single training. Read it with their numbers.
    """
    values = _checked(values)
    return _interval(float(values.mean()), values.shape[1], (values,), rng)


def difference_interval(first: Array, second: Array, rng: np.random.Generator, *, same_trainings: bool = False) -> Interval:
    """Compute the mean of `first` - `second`, two configurations on the same objects, as for `mean_interval`, and its interval.

    Objects are drawn, not values: the difficulty of an object, which both share, cancels. With `same_trainings`, both are figures of the
    same trainings in the same order, and differences between trainings cancel too.
    """
    if np.shape(first)[-1:] != np.shape(second)[-1:]:
        raise ValueError(f"{np.shape(first)} and {np.shape(second)} values cannot be paired: both need one per object")
    first, second = _checked(first), _checked(second)
    # the difference per object is exact where both are equal, which a difference of means is not
    parts = (first - second,) if same_trainings or len(first) == len(second) == 1 else (first, -second)
    return _interval(float(first.mean() - second.mean()), first.shape[1], parts, rng)


def _checked(values: Array) -> Array:  # (S, N)
    checked = np.asarray(values, np.float64)
    if checked.ndim not in (1, 2) or not checked.size or not np.isfinite(checked).all():
        raise ValueError(f"values of shape {checked.shape}: a mean needs finite values, one per object (and training), and one at least")
    return np.atleast_2d(checked)


def _interval(mean: float, count: int, parts: tuple[Array, ...], rng: np.random.Generator) -> Interval:
    """Compute the interval of the sum of the parts' means, (S, N) each with its own S."""
    if count == 1:
        return Interval(mean, -np.inf, np.inf, count)
    means = []
    for _ in range(RESAMPLES // BATCH):
        objects = _shares(count, rng)
        means.append(np.asarray(sum(((_shares(len(part), rng) @ part) * objects).sum(axis=1) for part in parts)))
    low, high = np.quantile(np.concatenate(means), ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
    return Interval(mean, float(low), float(high), count)


def _shares(count: int, rng: np.random.Generator) -> Array:
    """Draw how often each of `count` items occurs in `count` draws with replacement, as shares: (`BATCH`, count)."""
    return rng.multinomial(count, np.full(count, 1 / count), size=BATCH) / count
