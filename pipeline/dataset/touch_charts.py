"""Stored touch charts: how many vertices a side they have, and which of them show a surface."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pipeline.errors import StoreError
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from schemas.charts import CHARTS, FITTED


def is_surface(stop_rule: np.ndarray) -> np.ndarray:
    """(…) bool: whether a chart was fitted to a touch, by its `stop_rule` (…); the others are undeformed squares."""
    return np.isin(stop_rule, FITTED)


def chart_side(data: Path) -> int:
    """Vertices along a side of the charts in a data directory; a `StoreError` where there are none."""
    shards = Collection(Layout(data), CHARTS).shards
    if not shards:
        raise StoreError(f"{data.resolve()} has no charts; run fit-charts first")
    return math.isqrt(shards[0].array("vertices").shape[3])
