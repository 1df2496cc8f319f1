"""Tell which stored touch charts show a surface."""

import numpy as np

from schemas.charts import FITTED


def is_surface(stop_rule: np.ndarray) -> np.ndarray:  # (…) bool
    """Distinguish fitted charts from undeformed squares by their `stop_rule` (…)."""
    return np.isin(stop_rule, FITTED)
