"""Depth as it is stored: within half a step, and nothing but digits lost."""

import numpy as np
import pytest

from pipeline.config.sensor_file import load_sensor
from pipeline.kernels.touch.depth_quantisation import quantise_depth

SENSOR = load_sensor("gel_16mm")


@pytest.mark.parametrize(("gel_bits", "far_bits"), [(26, 20), (None, 20), (26, None), (None, None)])
def test_the_error_is_at_most_half_a_step(gel_bits, far_bits, rng):
    depth = rng.uniform(0, 0.05, (100, 100))
    stored = quantise_depth(depth, SENSOR, gel_bits=gel_bits, far_bits=far_bits)
    bits = np.where(depth < SENSOR.w, gel_bits or 99, far_bits or 99).astype(float)
    assert (np.abs(stored - depth) <= 2.0**-bits / 2 + np.spacing(depth.astype(np.float32)) / 2).all()


def test_what_was_not_met_stays_unmet():
    depth = np.array([[np.inf, 0.0, 1e-3]])
    np.testing.assert_array_equal(quantise_depth(depth, SENSOR, gel_bits=26, far_bits=20)[0, :2], [np.inf, 0])


def test_no_bits_given_is_float32():
    depth = np.random.default_rng(0).uniform(0, 0.05, 1000)
    np.testing.assert_array_equal(quantise_depth(depth, SENSOR, gel_bits=None, far_bits=None), depth.astype(np.float32))
