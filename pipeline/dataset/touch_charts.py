"""Which stored touch charts show a surface."""

from __future__ import annotations

import numpy as np

from schemas.charts import FITTED


def is_surface(stop_rule: np.ndarray) -> np.ndarray:
    """Tell fitted charts, by their `stop_rule` (…), from undeformed squares: (…) bool."""
    return np.isin(stop_rule, FITTED)
