"""Bootstrap intervals against slow twins and closed forms."""

from dataclasses import astuple

import numpy as np
import pytest

from pipeline.kernels.metrics.bootstrap import difference_interval, mean_interval


def test_interval_of_a_normal_mean_is_close_to_the_closed_form():
    values = np.random.default_rng(3).normal(5, 2, size=400)
    interval = mean_interval(values, np.random.default_rng(4))
    half = 1.96 * values.std() / 20
    assert interval.low == pytest.approx(values.mean() - half, abs=0.1 * half)
    assert interval.high == pytest.approx(values.mean() + half, abs=0.1 * half)


def test_difference_interval_cancels_the_difficulty_of_objects():
    rng = np.random.default_rng(5)
    hardness = rng.gamma(1.0, 100.0, size=50)
    first, second = hardness + rng.normal(1.0, 0.5, 50), hardness + rng.normal(0.0, 0.5, 50)
    paired = difference_interval(first, second, np.random.default_rng(0))
    assert 0 < paired.low < paired.mean < paired.high < 2
    apart = mean_interval(first, np.random.default_rng(0))
    assert apart.high - apart.low > 20 * (paired.high - paired.low)


@pytest.mark.parametrize("value", [0.1, -1e9, 1e-12])
def test_interval_of_equal_values_is_that_value(value):
    """To the rounding of a mean; an interval of differences that are all 0 is 0."""
    values = np.full(10, value)
    interval = mean_interval(values, np.random.default_rng(0))
    np.testing.assert_allclose([interval.mean, interval.low, interval.high], value, rtol=1e-14)
    same = difference_interval(values, values, np.random.default_rng(0))
    assert (same.mean, same.low, same.high) == (0, 0, 0)


def test_one_object_has_an_infinite_interval():
    interval = mean_interval(np.array([3.0]), np.random.default_rng(0))
    assert (interval.mean, interval.low, interval.high, interval.count) == (3.0, -np.inf, np.inf, 1)


@pytest.mark.parametrize("bad", [np.zeros(0), np.array([1.0, np.nan]), np.zeros((2, 2, 2))])
def test_mean_interval_rejects_empty_or_infinite_values(bad):
    with pytest.raises(ValueError, match="finite values"):
        mean_interval(bad, np.random.default_rng(0))


def test_interval_over_objects_and_trainings_has_the_variance_of_both():
    rng = np.random.default_rng(6)
    objects, trainings = rng.normal(0, 1, size=100), np.array([-0.6, 0.1, 0.5])
    values = 5 + objects + trainings[:, None]
    half = 1.96 * np.sqrt(objects.var() / 100 + trainings.var() / 3)
    interval = mean_interval(values, np.random.default_rng(7))
    assert interval.high - interval.low == pytest.approx(2 * half, rel=0.1)
    one = mean_interval(values[0], np.random.default_rng(7))
    assert one.high - one.low == pytest.approx(2 * 1.96 * objects.std() / 10, rel=0.1)
    easy = np.zeros(100) + trainings[:, None]  # what makes an object hard cancels, so that trainings alone leave a doubt
    paired = difference_interval(values, values[:2] + 0.3, np.random.default_rng(8))
    assert astuple(paired) == pytest.approx(astuple(difference_interval(easy, easy[:2] + 0.3, np.random.default_rng(8))))
    assert paired.mean == pytest.approx(trainings.mean() - trainings[:2].mean() - 0.3)


def test_difference_interval_rejects_unequal_numbers_of_objects():
    with pytest.raises(ValueError, match=r"\(3,\) and \(4,\)"):
        difference_interval(np.zeros(3), np.zeros(4), np.random.default_rng(0))
