"""Where extremes are drawn from: sizes of six decades, places as far as a kilometre, and meshes that no modeller would sign."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
scales = st.floats(-3, 3).map(lambda exponent: 10.0**exponent)
aspects = st.floats(0.5, 8).map(lambda exponent: 10.0**exponent)
offsets = st.tuples(*[st.floats(-1e3, 1e3)] * 3).map(np.array)
EPS = float(np.finfo(np.float64).eps)


def turn(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) any rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    rotation: np.ndarray = q * np.linalg.det(q)
    return rotation


def sliver(aspect: float, rng: np.random.Generator) -> np.ndarray:
    """(3, 3) a triangle of length 1, `aspect` times as long as it is high, anyhow turned."""
    flat = np.array([[0, 0, 0], [1, 0, 0], [rng.uniform(0.1, 0.9), 1 / aspect, 0]])
    triangle: np.ndarray = flat @ turn(rng).T
    return triangle
