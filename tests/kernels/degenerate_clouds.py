"""Degenerate clouds and meshes, and strategies for where and how large they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st

from tests.strategies import offsets

Array = np.ndarray

OFFSETS = st.sampled_from([np.zeros(3), np.array([0, 0, 0.6]), np.full(3, 1e2), np.array([-1e2, 1e2, 0])]) | offsets
"""m, from the origin: where objects are, and anywhere within 100 m."""

CLOUDS: dict[str, Callable[[np.random.Generator], Array]] = {
    "spread": lambda rng: rng.normal(size=(24, 3)),
    "one": lambda rng: rng.normal(size=(1, 3)),
    "two": lambda rng: rng.normal(size=(2, 3)),
    "collinear": lambda rng: rng.normal(size=(20, 1)) * rng.normal(size=(1, 3)),
    "plane": lambda rng: rng.normal(size=(20, 3)) * [1, 1, 0],
    "identical": lambda rng: np.repeat(rng.normal(size=(1, 3)), 20, axis=0),
    "duplicates": lambda rng: np.repeat(rng.normal(size=(8, 3)), 3, axis=0),
    "lattice": lambda _: np.stack(np.meshgrid(*[np.arange(3.0)] * 3), axis=-1).reshape(-1, 3),  # many are equally near
    "near and far": lambda rng: rng.normal(size=(20, 3)) * 10.0 ** -rng.integers(0, 9, (20, 1)),
}
"""Clouds about as large as 1, around the origin."""

KINDS = st.sampled_from(sorted(CLOUDS))


def cloud(kind: str, seed: int, scale: float, offset: Array) -> Array:
    """(N, 3) float64."""
    return np.asarray(CLOUDS[kind](np.random.default_rng(seed)) * scale + offset, np.float64)


def soup(seed: int) -> tuple[Array, Array]:
    """Triangles with nothing in common, a sliver of aspect 1e8, one twice and one inside out among them, segments and points too."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(6, 3, 3))
    corners[0, 2] = (corners[0, 0] + corners[0, 1]) / 2 + 1e-8 * rng.normal(size=3)  # a sliver
    corners[1, 2] = corners[1, 1]  # a segment
    corners[2] = corners[2, :1]  # a point
    corners[4] = corners[3, ::-1]  # inside out
    corners[5] = corners[3]  # a duplicate
    return corners.reshape(-1, 3), np.arange(18).reshape(-1, 3)
