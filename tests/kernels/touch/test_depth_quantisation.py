"""Quantised depth is within half a step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.kernels.touch.depth_maps import quantise_depth
from tests.kernels.touch.shapes import SENSOR
from tests.strategies import seeds


@given(seed=seeds, gel=st.one_of(st.none(), st.integers(10, 40)), far=st.one_of(st.none(), st.integers(10, 40)))
def test_quantisation_is_idempotent(seed, gel, far) -> None:
    rng = np.random.default_rng(seed)
    depth = np.concatenate([rng.uniform(0, 0.05, 200), SENSOR.w + rng.normal(size=50) * 1e-9, [0, np.inf, np.nextafter(SENSOR.w, 0)]])
    stored = quantise_depth(depth, SENSOR, gel_bits=gel, far_bits=far)
    step = np.where(depth < SENSOR.w, *(0 if bits is None else 2.0**-bits for bits in (gel, far)))
    finite = np.isfinite(depth)
    assert np.isinf(stored[~finite]).all()
    unit = np.spacing(depth[finite].astype(np.float32)).astype(np.float64)
    assert (np.abs(stored[finite] - depth[finite]) <= (step[finite] + unit * np.where(depth[finite] < SENSOR.w, 1, 2)) / 2).all()
    assert (stored[depth >= SENSOR.w] >= SENSOR.w).all()  # nothing touches that did not
    inner = np.abs(depth - SENSOR.w) > 1e-3  # what storing does not carry from the gel to beyond it, or back
    again = quantise_depth(stored.astype(np.float64), SENSOR, gel_bits=gel, far_bits=far)
    np.testing.assert_array_equal(again[inner & finite], stored[inner & finite])


def test_quantisation_refuses_nan() -> None:
    with pytest.raises(ValueError, match="depth holds NaN"):
        quantise_depth(np.full(SENSOR.shape, np.nan), SENSOR, gel_bits=26, far_bits=18)
