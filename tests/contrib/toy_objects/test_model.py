"""Stretching a model: proportions change, what is beyond them shifts."""

from math import inf

import numpy as np
import pytest

from pipeline.contrib.toy_objects.model import Model
from pipeline.contrib.toy_objects.solids import Material, rod


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [(-inf, inf, (-20.0, 0.0, 40.0)), (10.0, inf, (-10.0, 0.0, 30.0)), (-inf, -5.0, (-15.0, 0.0, 20.0)), (5.0, 10.0, (-10.0, 0.0, 25.0))],
)
def test_stretch_scales_between_two_positions_and_shifts_vertices_beyond(start, end, expected) -> None:
    model = Model(np.random.default_rng(0))
    model.add(Material((1, 2, 3)), rod(-10, 0, 3), rod(0, 20, 3))
    model.stretch("x", start, end, 2.0)
    first, second = (solid.vertices[:, 0] for solid in model.solids)
    assert (first.min(), first.max(), second.max()) == expected
    assert second.min() == 0.0
    assert model.solids[0].vertices[:, 2].max() == pytest.approx(3.0, rel=0.02)
