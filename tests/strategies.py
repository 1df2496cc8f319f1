"""Hypothesis strategies and random shapes: sizes of six decades, positions within 100 m, and badly shaped triangles."""

import numpy as np
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
scales = st.floats(-3, 3).map(lambda exponent: 10.0**exponent)
aspects = st.floats(0.5, 8).map(lambda exponent: 10.0**exponent)
offsets = st.tuples(*[st.floats(-1e2, 1e2)] * 3).map(np.array)
EPS = float(np.finfo(np.float64).eps)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) any rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    rotation: np.ndarray = q * np.linalg.det(q)
    return rotation


def sliver(aspect: float, rng: np.random.Generator) -> np.ndarray:
    """(3, 3) a triangle of length 1, `aspect` times as long as it is high, in any attitude."""
    flat = np.array([[0, 0, 0], [1, 0, 0], [rng.uniform(0.1, 0.9), 1 / aspect, 0]])
    triangle: np.ndarray = flat @ random_rotation(rng).T
    return triangle
