"""What `measure-press` trades: `vt-pipeline tradeoff measure-press` finds this module beside the stage's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.dataset.paired_rows import paired_rows
from pipeline.engine.trade import Trade


def press_errors(data: Path, reference: Path) -> dict[str, float]:
    """Compute the largest press that is missed, um by object."""
    return {name: 1e6 * float(np.abs(truth - press).max()) for name, (press,), (truth,) in paired_rows(data, reference, "press")}


TRADE = Trade(metric="press missed", unit="um", candidates=({"least": 1e-4},), errors=press_errors, reference={"least": 0.0})
