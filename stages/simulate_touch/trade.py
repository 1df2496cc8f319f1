"""The trade-off of `simulate-touch`: the accuracy of depth in the gel against bytes and time."""

from pathlib import Path

import numpy as np

from pipeline.dataset.paired_rows import paired_rows
from pipeline.dataset.touch_sensors import touch_sensors
from pipeline.engine.trade import Trade
from pipeline.store.directory import DataDirectory
from schemas.touch import TOUCH


def depth_errors(data: Path, reference: Path) -> dict[str, float]:
    """Compute the 99.9th percentile of the depth errors in the gel, um by object."""
    top = max(sensor.w for sensor in touch_sensors(DataDirectory(reference).collection(TOUCH).first.attributes))
    errors_by_object = {}
    for name, (depth,), (truth,) in paired_rows(data, reference, "depth"):
        in_gel = truth < top
        with np.errstate(invalid="ignore"):  # a hit that is lost or invented is infinitely wrong, unless both miss
            errors = np.where(depth == truth, 0.0, np.abs(depth.astype(np.float64) - truth))[in_gel]
        if errors.size:
            errors_by_object[name] = 1e6 * float(np.percentile(np.minimum(errors, top), 99.9))
    return errors_by_object


TRADE = Trade(
    metric="depth in the gel, 99.9 % within",
    unit="um",
    candidates=({"gel_bits": 14}, {"gel_bits": 18}, {"gel_bits": 22}, {"tracer": "sphere"}),
    errors=depth_errors,
    reference={"tracer": "ray", "gel_bits": None, "far_bits": None},
)
